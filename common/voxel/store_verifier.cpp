#include "common/voxel/store_verifier.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace quarry {
namespace {

/// Checks that the directory's box of a voxel is the box of its triangles.
Status CheckBounds(const VoxelGeometry& geometry, const VoxelEntry& entry) {
  const Box box = BoundsOf({geometry.vertices, geometry.vertex_count});
  if (box.lower == entry.bounds_lower && box.upper == entry.bounds_upper) return {};
  return Fail("its triangles lie elsewhere than the VDIR section states");
}

/// Checks that a voxel's list of VPRT has the parts of its triangles.
Status CheckParts(const VoxelGeometry& geometry, std::span<const uint32_t> stated) {
  std::vector<uint32_t> parts(geometry.triangle_count);
  for (uint32_t t = 0; t < geometry.triangle_count; ++t) parts[t] = geometry.part(t);
  std::ranges::sort(parts);
  parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
  if (std::ranges::equal(parts, stated)) return {};
  return Fail("its triangles have other parts than the VPRT section states");
}

}  // namespace

StoreVerifier::StoreVerifier(const StoreReader& store) : store_(store), blocks_end_(store.blocks_begin_) {
  if (store.has_parts_of_voxels()) lists_.emplace(store.part_sections().Lists());
}

Status StoreVerifier::CheckPartTree() const {
  const PartSections& sections = store_.part_sections();
  QUARRY_TRY(sections.ReadTree(store_.catalog().meta.input_triangles).map([](auto&&) {}));
  return sections.ReadAttributes().and_then([](const PartAttributes& all) { return all.Check(); });
}

Status StoreVerifier::CheckHot(uint32_t voxel, std::span<const std::byte> stored) {
  const Catalog& catalog = store_.catalog();
  Bytes decoded(catalog.block(BlockKey::Hot(voxel)).decoded);
  QUARRY_ASSIGN(const VoxelGeometry geometry, DecodeHot(decoder_, catalog, voxel, stored, decoded));
  QUARRY_TRY(CheckBounds(geometry, catalog.voxels[voxel]));
  if (!lists_) return {};
  QUARRY_ASSIGN(const std::span<const uint32_t> parts, lists_->Next(geometry.triangle_count));
  return CheckParts(geometry, parts);
}

Status StoreVerifier::CheckVoxel(uint32_t voxel) {
  const Catalog& catalog = store_.catalog();
  for (BlockKind kind : {BlockKind::kHot, BlockKind::kShading}) {
    const BlockKey id(kind, voxel);
    const BlockEntry& entry = catalog.block(id);
    if (entry.offset != blocks_end_)
      return Fail(fmt::format("{}: block {} is not where it should be", store_.path(), catalog.NumberOf(id)));
    blocks_end_ += entry.stored;
    if (entry.stored == 0) continue;
    QUARRY_ASSIGN(const Bytes stored, store_.ReadBlock(id));
    Bytes decoded(entry.decoded);
    const Status status = kind == BlockKind::kHot
                              ? CheckHot(voxel, stored)
                              : DecodeShading(decoder_, catalog, voxel, stored, decoded).map([](auto&&) {});
    if (!status)
      return Fail(fmt::format("{}: block {} at byte {}: {}", store_.path(), catalog.NumberOf(id),
                              entry.offset, status.error().message));
  }
  return {};
}

Status StoreVerifier::CheckVoxelsEnd() const {
  if (blocks_end_ != store_.blocks_end_)
    return Fail(fmt::format("{}: the blocks end at byte {}, their section at {}", store_.path(), blocks_end_,
                            store_.blocks_end_));
  return lists_ ? lists_->CheckEnd() : Status{};
}

Status StoreVerifier::CheckTexture(uint32_t texture) const {
  for (uint32_t p = 0; p < store_.textures()[texture].pages.size(); ++p)
    QUARRY_TRY(store_.ReadPage(texture, p).map([](auto&&) {}));
  return {};
}

Status StoreVerifier::CheckPagesFill() const {
  std::vector<std::pair<uint64_t, uint64_t>> places;
  for (const Texture& t : store_.textures())
    for (const BlockEntry& page : t.pages) places.emplace_back(page.offset, page.offset + page.stored);
  std::ranges::sort(places);
  uint64_t end = store_.pages_begin_;
  for (const auto& [first, last] : places) {
    if (first != end)
      return Fail(fmt::format("{}: the page at byte {} is not where it should be", store_.path(), first));
    end = last;
  }
  if (end == store_.pages_end_) return {};
  return Fail(fmt::format("{}: the pages end at byte {}, their section at {}", store_.path(), end,
                          store_.pages_end_));
}

}  // namespace quarry
