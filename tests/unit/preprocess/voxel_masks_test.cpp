#include "preprocess/partition/voxel_masks.h"

#include <catch2/catch.hpp>
#include <vector>

#include "preprocess/partition/voxel_builder.h"

namespace quarry {
namespace {

/// Words of a fine mask that are as large as a sub-triangle of a coarse one.
constexpr int32_t kWords = kFineSubTriangles / kSubTriangles / 16;

/// The states that the tests give triangles by the x of their first corner: so many times kWords words of the
/// fine mask are opaque, the rest and all of the coarse mask is mixed. Material 0 has no masks.
TriangleMasks ByCorner() {
  return {[](uint32_t material) { return material != 0; },
          [](const TriangleRecord& t) {
            MaskPlace place;
            place.material = t.material;
            for (int a = 0; a < 2; ++a) place.corners[0][a] = static_cast<int32_t>(t.uvs[0][a]);
            return place;
          },
          [](const MaskPlace& place, bool) {
            TriangleMask mask{0, {}};
            for (int32_t w = 0; w < kWords * place.corners[0][0]; ++w) mask.fine.words[w] = kOpaqueMask;
            return mask;
          }};
}

TriangleRecord Of(uint32_t material, float u, float v = 0) {
  TriangleRecord t;
  t.material = static_cast<uint16_t>(material);
  t.uvs[0] = {u, v};
  return t;
}

}  // namespace

TEST_CASE("Triangles of equal states share a fine mask", "[texture]") {
  const std::vector<TriangleRecord> triangles{Of(1, 3), Of(0, 3), Of(1, 2), Of(1, 3), Of(2, 3), Of(1, 3, 7)};
  const VoxelMasks found = FindMasks(triangles, ByCorner(), 10);
  CHECK(found.masks == std::vector<uint32_t>{NameFineMask(0), kOpaqueMask, NameFineMask(1), NameFineMask(0),
                                             NameFineMask(0), NameFineMask(0)});
  REQUIRE(found.fine.size() == 2);
  CHECK(found.fine[0].words[3 * kWords - 1] == kOpaqueMask);
  CHECK(found.fine[1].words[3 * kWords - 1] == 0);
}

TEST_CASE("The fine masks that decide most are kept, in the order of triangles", "[texture]") {
  // Gains: 5, 2 * 3, 1, 4.
  const std::vector<TriangleRecord> triangles{Of(1, 5), Of(1, 3), Of(1, 1), Of(1, 3), Of(1, 4)};
  const VoxelMasks two = FindMasks(triangles, ByCorner(), 2);
  CHECK(two.masks == std::vector<uint32_t>{NameFineMask(0), NameFineMask(1), 0, NameFineMask(1), 0});
  const VoxelMasks none = FindMasks(triangles, ByCorner(), 0);
  CHECK(none.masks == std::vector<uint32_t>(5, 0));
  CHECK(none.fine.empty());
}

TEST_CASE("A fine mask that decides little beyond the coarse one is not kept", "[texture]") {
  TriangleMasks masks = ByCorner();
  masks.mask_at = [](const MaskPlace& place, bool) {
    TriangleMask mask{kOpaqueMask & ~3u, {}};  // all but one sub-triangle are opaque
    for (uint32_t& word : mask.fine.words) word = kOpaqueMask;
    // Of the fine ones in it, some stay open.
    for (int32_t sub = 0; sub < place.corners[0][0]; ++sub) mask.fine.words[0] &= ~(3u << (2 * sub));
    return mask;
  };
  const std::vector<TriangleRecord> triangles{Of(1, 1), Of(1, 0)};
  const VoxelMasks found = FindMasks(triangles, masks, 10);
  CHECK(found.masks == std::vector<uint32_t>{kOpaqueMask & ~3u, NameFineMask(0)});
}

TEST_CASE("Fine masks leave a voxel within its size, however many triangles it has", "[texture]") {
  constexpr uint32_t kSize = 64 << 10;
  const uint32_t most = MaxTrianglesPerVoxel(kSize, true);
  // No two triangles share a vertex, or a fine mask.
  TriangleMasks masks = ByCorner();
  masks.mask_at = [](const MaskPlace& place, bool) {
    TriangleMask mask{0, {}};
    for (uint32_t& word : mask.fine.words) word = kOpaqueMask;
    mask.fine.words[0] &= 3u * static_cast<uint32_t>(place.corners[0][0]);
    mask.fine.words[1] &= 3u * static_cast<uint32_t>(place.corners[0][1]);
    return mask;
  };
  for (const uint32_t count : {most, most * 9 / 10, most / 2}) {
    VoxelTask task;
    task.cell = {glm::vec3(0), glm::vec3(64)};
    for (uint32_t i = 0; i < count; ++i) {
      TriangleRecord t = Of(1, static_cast<float>(i % 64), static_cast<float>(i / 64));
      const glm::vec3 at(static_cast<float>(i % 16), static_cast<float>(i / 16 % 16),
                         static_cast<float>(i / 256));
      t.vertices[0] = at;
      t.vertices[1] = at + glm::vec3(0.5f, 0, 0);
      t.vertices[2] = at + glm::vec3(0, 0.5f, 0.25f);
      t.id = i;
      task.triangles.push_back(t);
    }
    const EncodedVoxel voxel = BuildVoxel(task, 1e-5f, {}, kSize, &masks);
    INFO(count << " triangles");
    CHECK(voxel.hot_decoded <= kSize);
    CHECK(voxel.triangles == count);
  }
}

}  // namespace quarry
