#include "common/voxel/voxel_block.h"

#include <lz4.h>
#include <lz4hc.h>

#include <algorithm>

#include "common/base/check.h"
#include "common/kdtree/build/treelets.h"
#include "common/kdtree/wide_node.h"
#include "common/voxel/byte_planes.h"
#include "common/voxel/tree_streams.h"

namespace quarry {
namespace {

// LZ4 HC level. Trades bytes of the store against time of preprocessing (tests/bench/history/store_format.md,
// 2026-11-21).
constexpr int kCompressionLevel = 3;

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

}  // namespace

size_t HotBytes(size_t wide_nodes, size_t references, size_t triangles, size_t vertices) {
  return wide_nodes * sizeof(WideNode) + vertices * 12 + triangles * (4 + 4 + 2 + 6) + references * 2;
}

size_t ShadingBytes(size_t triangles, size_t vertices) {
  return vertices * sizeof(ShadingVertex) + triangles * 6;
}

Bytes EncodeHot(const HotVoxel& v) {
  QUARRY_CHECK(v.triangle_ids.size() <= kMaxVoxelTriangles && v.vertices.size() <= 65535);
  CheckReferences(v);
  ByteWriter header;
  header.Put(kHotMagic);
  header.Put(static_cast<uint32_t>(v.triangle_ids.size()));
  header.Put(static_cast<uint32_t>(v.vertices.size()));
  header.Put(static_cast<uint32_t>(v.references.size()));
  header.Put(static_cast<uint32_t>(v.nodes.size() / 2));
  header.Put(v.node_slots);
  header.Put(v.wide_nodes);
  header.PutVec3(v.cell.lower);
  header.PutVec3(v.cell.upper);
  Bytes out = header.Take();
  PutTree(LayOutTreelets(v.nodes, kTreeletLevels, v.cell), out);
  PutVertices(v.vertices, out);
  PutFromNewest(v.corners, out);
  PutDifferences<uint32_t>(v.triangle_ids, out);
  PutDifferences<uint32_t>(v.parts, out);
  PutPlanes<uint16_t>(v.materials, out);
  PutFromNewest(v.references, out);
  return out;
}

Bytes EncodeShading(const ShadingVoxel& v) {
  QUARRY_CHECK_LE(v.vertices.size(), size_t{65535});
  ByteWriter header;
  header.Put(kShadingMagic);
  header.Put(static_cast<uint32_t>(v.corners.size() / 3));
  header.Put(static_cast<uint32_t>(v.vertices.size()));
  Bytes out = header.Take();
  std::vector<uint32_t> column(v.vertices.size());
  const auto put = [&](auto&& value) {
    std::ranges::transform(v.vertices, column.begin(), value);
    PutDifferences<uint32_t>(column, out);
  };
  for (int a = 0; a < 3; ++a) put([a](const ShadingVertex& x) { return OrderedBits(x.normal[a]); });
  for (int a = 0; a < 2; ++a) put([a](const ShadingVertex& x) { return OrderedBits(x.uv[a]); });
  put([](const ShadingVertex& x) { return x.color; });
  PutFromNewest(v.corners, out);
  return out;
}

uint32_t CompressorVersion() { return static_cast<uint32_t>(LZ4_versionNumber()); }

Bytes CompressBlock(std::span<const std::byte> streams) {
  Bytes packed(static_cast<size_t>(LZ4_compressBound(static_cast<int>(streams.size()))));
  const int size =
      LZ4_compress_HC(reinterpret_cast<const char*>(streams.data()), reinterpret_cast<char*>(packed.data()),
                      static_cast<int>(streams.size()), static_cast<int>(packed.size()), kCompressionLevel);
  QUARRY_CHECK(size > 0);
  const bool smaller = static_cast<size_t>(size) < streams.size();
  ByteWriter stored;
  stored.Put(static_cast<uint32_t>(streams.size()));
  stored.PutArray(smaller ? std::span<const std::byte>(packed).first(static_cast<size_t>(size)) : streams);
  return stored.Take();
}

}  // namespace quarry
