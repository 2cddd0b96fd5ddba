#include "common/voxel/voxel_block.h"

#include <fmt/format.h>
#include <lz4.h>
#include <lz4hc.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "common/base/check.h"
#include "common/kdtree/treelets.h"
#include "common/kdtree/wide_tree.h"

namespace quarry {
namespace {

constexpr uint32_t kHotMagic = 0x33585651;      // "QVX3"
constexpr uint32_t kShadingMagic = 0x31535651;  // "QVS1"
constexpr size_t kHotHeader = 64;               // both kinds of nodes begin with a cache line
constexpr size_t kShadingHeader = 16;
constexpr int kCompressionLevel = 9;

/// Where `count` values of T lie; moves `at` past them. Sizes were checked against the block before.
template <class T>
const T* ViewArray(std::span<const std::byte> bytes, size_t& at, size_t count) {
  const auto* first = reinterpret_cast<const T*>(bytes.data() + at);
  at += count * sizeof(T);
  return first;
}

/// Together leaves have no more references than there are, so that work on all of them ends.
Status CheckLeaves(const VoxelGeometry& v) {
  uint64_t total = 0;
  for (uint32_t i = 0; i < v.node_count; ++i) {
    const KdNode& n = v.nodes[i];
    if (!n.is_leaf()) continue;
    if (n.first() > v.reference_count || n.count() > v.reference_count - n.first() ||
        n.count() > v.triangle_count)
      return Fail(fmt::format("voxel block: leaf {} goes beyond the references", i));
    total += n.count();
  }
  if (total > v.reference_count) return Fail("voxel block: leaves have references in common");
  return {};
}

Status FillWideNodes(const VoxelGeometry& v, const Box& cell, float padding, std::span<std::byte> out) {
  const std::vector<WideNode> wide = MakeWideTree(v, cell, padding);
  if (wide.size() != v.wide_count) return Fail("voxel block: not as many wide nodes as its tree has");
  std::memcpy(out.data(), wide.data(), out.size());
  return {};
}

template <class T>
bool AllBelow(const T* values, size_t count, uint32_t limit) {
  return std::all_of(values, values + count, [&](T x) { return x < limit; });
}

}  // namespace

size_t HotBytes(size_t nodes, size_t wide_nodes, size_t references, size_t triangles, size_t vertices) {
  return kHotHeader + wide_nodes * sizeof(WideNode) + nodes * 8 + vertices * 12 +
         triangles * (4 + 4 + 2 + 6) + references * 2;
}

Bytes LayOutHot(const HotVoxel& v) {
  QUARRY_CHECK(v.triangle_ids.size() <= kMaxVoxelTriangles && v.vertices.size() <= 65535);
  ByteWriter out;
  out.Put(kHotMagic);
  out.Put(static_cast<uint32_t>(v.triangle_ids.size()));
  out.Put(static_cast<uint32_t>(v.vertices.size()));
  out.Put(static_cast<uint32_t>(v.nodes.size()));
  out.Put(static_cast<uint32_t>(v.references.size()));
  out.PutVec3(v.cell.lower);
  out.PutVec3(v.cell.upper);
  out.Put(v.wide_nodes);
  for (int i = 0; i < 4; ++i) out.Put(uint32_t{0});
  out.PutArray(std::vector<std::byte>(v.wide_nodes * sizeof(WideNode)));
  out.PutArray(v.nodes);
  out.PutArray(v.vertices);
  out.PutArray(v.triangle_ids);
  out.PutArray(v.parts);
  out.PutArray(v.materials);
  out.PutArray(v.corners);
  out.PutArray(v.references);
  return out.Take();
}

Result<VoxelGeometry> ViewHot(std::span<std::byte> bytes, float padding) {
  ByteReader in(bytes);
  const auto magic = in.Get<uint32_t>();
  VoxelGeometry v;
  v.triangle_count = in.Get<uint32_t>();
  v.vertex_count = in.Get<uint32_t>();
  v.node_count = in.Get<uint32_t>();
  v.reference_count = in.Get<uint32_t>();
  const Box cell{in.GetVec3<glm::vec3>(), in.GetVec3<glm::vec3>()};
  v.wide_count = in.Get<uint32_t>();
  if (!in.ok() || magic != kHotMagic) return Fail("voxel block: not a hot block");
  if (v.triangle_count > kMaxVoxelTriangles || v.vertex_count > 65535 || v.node_count == 0 ||
      v.node_count > kMaxBlockBytes / 8 || v.reference_count > kMaxBlockBytes / 2 ||
      v.wide_count > kMaxBlockBytes / sizeof(WideNode) ||
      HotBytes(v.node_count, v.wide_count, v.reference_count, v.triangle_count, v.vertex_count) !=
          bytes.size())
    return Fail("voxel block: counts do not fit its size");
  size_t at = kHotHeader;
  const std::span<std::byte> wide = bytes.subspan(at, v.wide_count * sizeof(WideNode));
  v.wide = ViewArray<WideNode>(bytes, at, v.wide_count);
  const std::span<KdNode> nodes(reinterpret_cast<KdNode*>(bytes.data() + at), v.node_count);
  v.nodes = ViewArray<KdNode>(bytes, at, v.node_count);
  v.vertices = ViewArray<glm::vec3>(bytes, at, v.vertex_count);
  v.triangle_ids = ViewArray<uint32_t>(bytes, at, v.triangle_count);
  v.parts = ViewArray<uint32_t>(bytes, at, v.triangle_count);
  v.materials = ViewArray<uint16_t>(bytes, at, v.triangle_count);
  v.corners = ViewArray<uint16_t>(bytes, at, size_t{3} * v.triangle_count);
  v.references = ViewArray<uint16_t>(bytes, at, v.reference_count);
  if (!AllBelow(v.corners, size_t{3} * v.triangle_count, v.vertex_count))
    return Fail("voxel block: a corner goes beyond the vertices");
  if (!AllBelow(v.references, v.reference_count, v.triangle_count))
    return Fail("voxel block: a reference goes beyond the triangles");
  // Before the headers: they are floats, in slots where leaves could be seen.
  QUARRY_TRY(CheckLeaves(v));
  for (int a = 0; a < 3; ++a)
    if (!std::isfinite(cell.lower[a]) || !std::isfinite(cell.upper[a]))
      return Fail("voxel block: its cell is not finite");
  if (const Status status = FillTreeletHeaders(nodes, kTreeletLevels, cell); !status)
    return Fail("voxel block: " + status.error().message);
  QUARRY_TRY(FillWideNodes(v, cell, padding, wide));
  return v;
}

Bytes LayOutShading(const ShadingVoxel& v) {
  QUARRY_CHECK(v.vertices.size() <= 65535);
  ByteWriter out;
  out.Put(kShadingMagic);
  out.Put(static_cast<uint32_t>(v.corners.size() / 3));
  out.Put(static_cast<uint32_t>(v.vertices.size()));
  out.Put(uint32_t{0});
  out.PutArray(v.vertices);
  out.PutArray(v.corners);
  return out.Take();
}

Result<VoxelShading> ViewShading(std::span<const std::byte> bytes) {
  ByteReader in(bytes);
  const auto magic = in.Get<uint32_t>();
  VoxelShading v;
  v.triangle_count = in.Get<uint32_t>();
  const auto vertex_count = in.Get<uint32_t>();
  if (!in.ok() || magic != kShadingMagic) return Fail("voxel block: not a shading block");
  if (v.triangle_count > kMaxVoxelTriangles || vertex_count > 65535 ||
      kShadingHeader + size_t{vertex_count} * sizeof(ShadingVertex) + size_t{6} * v.triangle_count !=
          bytes.size())
    return Fail("voxel block: counts do not fit its size");
  size_t at = kShadingHeader;
  v.vertices = ViewArray<ShadingVertex>(bytes, at, vertex_count);
  v.corners = ViewArray<uint16_t>(bytes, at, size_t{3} * v.triangle_count);
  if (!AllBelow(v.corners, size_t{3} * v.triangle_count, vertex_count))
    return Fail("voxel block: a corner goes beyond the shading vertices");
  return v;
}

Bytes CompressBlock(std::span<const std::byte> decoded) {
  Bytes stored(static_cast<size_t>(LZ4_compressBound(static_cast<int>(decoded.size()))));
  const int size =
      LZ4_compress_HC(reinterpret_cast<const char*>(decoded.data()), reinterpret_cast<char*>(stored.data()),
                      static_cast<int>(decoded.size()), static_cast<int>(stored.size()), kCompressionLevel);
  QUARRY_CHECK(size > 0);
  if (static_cast<size_t>(size) >= decoded.size()) return Bytes(decoded.begin(), decoded.end());
  stored.resize(static_cast<size_t>(size));
  return stored;
}

Status DecompressBlock(std::span<const std::byte> stored, std::span<std::byte> out) {
  if (stored.size() == out.size()) {
    std::memcpy(out.data(), stored.data(), out.size());
    return {};
  }
  const int size =
      LZ4_decompress_safe(reinterpret_cast<const char*>(stored.data()), reinterpret_cast<char*>(out.data()),
                          static_cast<int>(stored.size()), static_cast<int>(out.size()));
  if (size < 0 || static_cast<size_t>(size) != out.size())
    return Fail("voxel block: does not decompress to the size its directory entry gives");
  return {};
}

}  // namespace quarry
