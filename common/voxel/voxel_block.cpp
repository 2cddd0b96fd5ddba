#include "common/voxel/voxel_block.h"

#include <lz4.h>
#include <lz4hc.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <type_traits>

#include "common/base/check.h"
#include "common/kdtree/build/treelets.h"
#include "common/kdtree/wide_node.h"
#include "common/math/packed_normal.h"
#include "common/voxel/streams/byte_planes.h"
#include "common/voxel/streams/tree_streams.h"

namespace quarry {
namespace {

// LZ4 HC level. Trades bytes of the store against time of preprocessing (tests/bench/history/store_format.md,
// 2026-11-21).
constexpr int kCompressionLevel = 2;

/// Decoders rely on leaves' references being contiguous, from the leftmost leaf on.
void CheckReferences(const HotVoxel& voxel) {
  uint32_t references = 0;
  std::vector<uint32_t> visits{0};
  while (!visits.empty()) {
    const KdNode& n = voxel.nodes[visits.back()];
    visits.pop_back();
    if (n.is_leaf()) {
      QUARRY_CHECK(n.count() == 0 || n.first() == references);
      references += n.count();
    } else {
      visits.push_back(n.left() + 1);
      visits.push_back(n.left());
    }
  }
  QUARRY_CHECK_EQ(references, voxel.references.size());
}

void PutVertices(std::span<const glm::vec3> vertices, Bytes& out) {
  std::vector<uint32_t> ordered(vertices.size());
  for (int a = 0; a < 3; ++a) {
    std::ranges::transform(vertices, ordered.begin(), [a](const glm::vec3& v) { return OrderedBits(v[a]); });
    PutDifferences<uint32_t>(ordered, out);
  }
}

/// Puts a column of the vertices: its value of each.
template <class Value>
void PutColumn(const ShadingVoxel& v, Bytes& out, Value&& value) {
  using T = std::decay_t<decltype(value(v.vertices[0]))>;
  std::vector<T> column(v.vertices.size());
  std::ranges::transform(v.vertices, column.begin(), value);
  PutDifferences<T>(column, out);
}

uint32_t PackedOrNone(const glm::vec3& normal) { return normal == glm::vec3(0) ? 0 : PackNormal(normal); }

Bytes EncodePacked(const ShadingVoxel& v) {
  const auto some = [&](auto&& differs) { return std::ranges::any_of(v.vertices, differs); };
  const bool uvs = some([](const ShadingVertex& x) { return x.uv != glm::vec2(0); });
  const bool colors = some([](const ShadingVertex& x) { return x.color != ShadingVertex{}.color; });
  ByteWriter header;
  header.Put(kPackedMagic);
  header.Put(static_cast<uint32_t>(v.corners.size() / 3));
  header.Put(static_cast<uint32_t>(v.vertices.size()));
  header.Put((uvs ? kPackedUvs : 0) | (colors ? kPackedColors : 0));
  Bytes out = header.Take();
  for (int half = 0; half < 2; ++half)
    PutColumn(v, out, [half](const ShadingVertex& x) {
      return static_cast<uint16_t>(PackedOrNone(x.normal) >> (16 * half));
    });
  for (int a = 0; a < 2 && uvs; ++a)
    PutColumn(v, out, [a](const ShadingVertex& x) { return OrderedBits(x.uv[a]); });
  if (colors) PutColumn(v, out, [](const ShadingVertex& x) { return x.color; });
  PutFromNewest(v.corners, out);
  return out;
}

}  // namespace

size_t HotBytes(size_t wide_nodes, size_t references, size_t triangles, size_t vertices, size_t masks,
                size_t fine_masks) {
  return wide_nodes * sizeof(WideNode) + vertices * 12 + triangles * (4 + 4 + 2 + 6) + references * 2 +
         masks * 4 + fine_masks * sizeof(FineMask);
}

size_t ShadingBytes(size_t triangles, size_t vertices) {
  return vertices * sizeof(ShadingVertex) + triangles * 6;
}

Bytes EncodeHot(const HotVoxel& v) {
  QUARRY_CHECK(v.triangle_ids.size() <= kMaxVoxelTriangles && v.vertices.size() <= 65535);
  QUARRY_CHECK(v.masks.size() == (v.masks.empty() ? 0 : v.triangle_ids.size()));
  QUARRY_CHECK(v.fine_masks.size() <= v.masks.size());
  CheckReferences(v);
  ByteWriter header;
  header.Put(v.masks.empty() ? kHotMagic : kMaskedMagic);
  header.Put(static_cast<uint32_t>(v.triangle_ids.size()));
  header.Put(static_cast<uint32_t>(v.vertices.size()));
  header.Put(static_cast<uint32_t>(v.references.size()));
  header.Put(static_cast<uint32_t>(v.nodes.size() / 2));
  header.Put(v.node_slots);
  header.Put(v.wide_nodes);
  header.PutVec3(v.cell.lower);
  header.PutVec3(v.cell.upper);
  if (!v.masks.empty()) header.Put(static_cast<uint32_t>(v.fine_masks.size()));
  Bytes out = header.Take();
  out.reserve(out.size() + v.nodes.size() * 4 + v.vertices.size() * 12 + v.triangle_ids.size() * 20 +
              v.references.size() * 2);
  PutTree(LayOutTreelets(v.nodes, kTreeletLevels, v.cell), out);
  PutVertices(v.vertices, out);
  PutFromNewest(v.corners, out);
  PutDifferences<uint32_t>(v.triangle_ids, out);
  PutDifferences<uint32_t>(v.parts, out);
  PutPlanes<uint16_t>(v.materials, out);
  PutPlanes<uint32_t>(v.masks, out);
  const auto fine = std::as_bytes(std::span(v.fine_masks));
  out.insert(out.end(), fine.begin(), fine.end());
  PutFromNewest(v.references, out);
  return out;
}

Bytes EncodeShading(const ShadingVoxel& v) {
  QUARRY_CHECK_LE(v.vertices.size(), size_t{65535});
  if (v.packed) return EncodePacked(v);
  ByteWriter header;
  header.Put(kShadingMagic);
  header.Put(static_cast<uint32_t>(v.corners.size() / 3));
  header.Put(static_cast<uint32_t>(v.vertices.size()));
  Bytes out = header.Take();
  for (int a = 0; a < 3; ++a)
    PutColumn(v, out, [a](const ShadingVertex& x) { return OrderedBits(x.normal[a]); });
  for (int a = 0; a < 2; ++a) PutColumn(v, out, [a](const ShadingVertex& x) { return OrderedBits(x.uv[a]); });
  PutColumn(v, out, [](const ShadingVertex& x) { return x.color; });
  PutFromNewest(v.corners, out);
  return out;
}

uint32_t CompressorVersion() { return static_cast<uint32_t>(LZ4_versionNumber()); }

Bytes CompressBlock(std::span<const std::byte> streams) {
  // A new state for each block would cost a third of the time: it takes 256 KB, cleared.
  thread_local const std::unique_ptr<LZ4_streamHC_t, decltype(&LZ4_freeStreamHC)> state(LZ4_createStreamHC(),
                                                                                        LZ4_freeStreamHC);
  QUARRY_CHECK(state != nullptr);
  LZ4_resetStreamHC_fast(state.get(), kCompressionLevel);
  const auto most = static_cast<size_t>(LZ4_compressBound(static_cast<int>(streams.size())));
  const auto packed = std::make_unique_for_overwrite<std::byte[]>(most);
  const int size = LZ4_compress_HC_continue(state.get(), reinterpret_cast<const char*>(streams.data()),
                                            reinterpret_cast<char*>(packed.get()),
                                            static_cast<int>(streams.size()), static_cast<int>(most));
  QUARRY_CHECK(size > 0);
  const auto bytes = static_cast<uint32_t>(streams.size());
  const bool smaller = static_cast<size_t>(size) < streams.size();
  const std::span<const std::byte> content =
      smaller ? std::span<const std::byte>(packed.get(), static_cast<size_t>(size)) : streams;
  Bytes stored;
  stored.reserve(sizeof bytes + content.size());
  const std::span<const std::byte> head = std::as_bytes(std::span(&bytes, 1));
  stored.insert(stored.end(), head.begin(), head.end());
  stored.insert(stored.end(), content.begin(), content.end());
  return stored;
}

}  // namespace quarry
