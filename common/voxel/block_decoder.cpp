#include "common/voxel/block_decoder.h"

#include <lz4.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "common/kdtree/opacity_mask.h"
#include "common/math/packed_normal.h"
#include "common/voxel/streams/byte_planes.h"
#include "common/voxel/streams/tree_completion.h"
#include "common/voxel/streams/tree_streams.h"

namespace quarry {
namespace {

// --- the hot block's counts, which give all sizes

struct HotCounts {
  uint32_t triangles, vertices, references, inner_nodes, node_slots, wide_nodes, fine_masks;
  bool masked;

  size_t header_bytes() const { return masked ? kMaskedHeaderBytes : kHotHeaderBytes; }
  size_t masks() const { return masked ? triangles : 0; }
  size_t nodes() const { return size_t{2} * inner_nodes + 1; }
  size_t stream_bytes() const {
    return header_bytes() + nodes() * 2 + size_t{inner_nodes} * 4 + size_t{vertices} * 12 +
           size_t{triangles} * (6 + 4 + 4 + 2) + masks() * 4 + size_t{fine_masks} * sizeof(FineMask) +
           size_t{references} * 2;
  }
  size_t decoded_bytes() const {
    return HotBytes(wide_nodes, references, triangles, vertices, masks(), fine_masks);
  }
  /// Whether each count is so small that sums of sizes cannot overflow.
  bool sane() const {
    return triangles > 0 && triangles <= kMaxVoxelTriangles && vertices > 0 && vertices <= 65535 &&
           references <= kMaxBlockBytes / 2 && inner_nodes <= kMostInnerNodes &&
           wide_nodes <= kMaxBlockBytes / sizeof(WideNode) && wide_nodes > 0 && nodes() < node_slots &&
           node_slots <= decoded_bytes() / sizeof(KdNode) && fine_masks <= triangles;
  }
};

/// Cuts the streams of a block off in order. Requires: the sum of the sizes was checked against the whole.
class StreamCutter {
 public:
  StreamCutter(std::span<const std::byte> streams, size_t header) : rest_(streams.subspan(header)) {}
  std::span<const std::byte> Next(size_t bytes) {
    const auto stream = rest_.first(bytes);
    rest_ = rest_.subspan(bytes);
    return stream;
  }

 private:
  std::span<const std::byte> rest_;
};

/// Places arrays one behind the other in a decoded block.
class ArrayPlacer {
 public:
  explicit ArrayPlacer(std::span<std::byte> out) : out_(out) {}
  template <class T>
  T* Next(size_t count) {
    auto* first = reinterpret_cast<T*>(out_.data() + at_);
    at_ += count * sizeof(T);
    return first;
  }

 private:
  std::span<std::byte> out_;
  size_t at_ = 0;
};

/// Errors, permanent: a mask is none; it names a fine mask that the voxel lacks.
Status CheckMasks(std::span<const uint32_t> masks, std::span<const FineMask> fine) {
  for (const uint32_t mask : masks) {
    if (IsMask(mask, static_cast<uint32_t>(fine.size()))) continue;
    return Fail(NamesFineMask(mask) && mask >= kFineMaskTag
                    ? "voxel block: an opacity mask names a fine mask that it lacks"
                    : "voxel block: an opacity mask holds an invalid state");
  }
  for (const FineMask& mask : fine)
    if (!std::ranges::all_of(mask.words, HoldsStates))
      return Fail("voxel block: a fine opacity mask holds an invalid state");
  return {};
}

/// Bytes in the streams of a vertex of a packed shading block.
size_t PackedVertexBytes(uint32_t columns) {
  return 4 + ((columns & kPackedUvs) != 0 ? 8 : 0) + ((columns & kPackedColors) != 0 ? 4 : 0);
}

}  // namespace

struct BlockDecoder::Impl {
  Bytes room;
  std::span<std::byte> streams;  ///< of the present block
  std::vector<uint32_t> column;
  std::vector<uint16_t> halves;
  TreeReader tree;
  std::vector<KdNode> nodes;  ///< receives the tree when the caller does not want it
  TreeCompletion completion;

  Status Decompress(std::span<const std::byte> stored, size_t most);
  const uint32_t* ReadColumns(std::span<const std::byte> columns, size_t count);
  void ReadVertices(std::span<const std::byte> columns, std::span<glm::vec3> vertices);
  void ReadShading(std::span<const std::byte> columns, std::span<ShadingVertex> vertices);
  void ReadPacked(std::span<const std::byte> columns, uint32_t kinds, std::span<ShadingVertex> vertices);
};

BlockDecoder::BlockDecoder() : impl_(std::make_unique<Impl>()) {}
BlockDecoder::~BlockDecoder() = default;

Status BlockDecoder::Impl::Decompress(std::span<const std::byte> stored, size_t most) {
  ByteReader in(stored);
  const auto size = in.Get<uint32_t>();
  const auto packed = in.GetSpan(in.remaining());
  if (!in.ok() || size > MostStored(most))
    return Fail("voxel block: more bytes than the directory's entry allows");
  // Never shrinks: resize() would clear the bytes that it adds again.
  if (room.size() < size) room.resize(size);
  streams = {room.data(), size};
  if (packed.size() == size) {
    std::ranges::copy(packed, streams.begin());
    return {};
  }
  const int got = LZ4_decompress_safe(reinterpret_cast<const char*>(packed.data()),
                                      reinterpret_cast<char*>(streams.data()),
                                      static_cast<int>(packed.size()), static_cast<int>(size));
  if (got < 0 || static_cast<size_t>(got) != size) return Fail("voxel block: LZ4 cannot decompress it");
  return {};
}

/// Decodes columns of `count` differences each, stored one behind the other.
const uint32_t* BlockDecoder::Impl::ReadColumns(std::span<const std::byte> columns, size_t count) {
  const size_t bytes = count * sizeof(uint32_t), values = columns.size() / sizeof(uint32_t);
  if (column.size() < values) column.resize(values);
  for (size_t at = 0; at < values; at += count)
    ReadDifferences(columns.subspan(at * sizeof(uint32_t), bytes), {column.data() + at, count});
  return column.data();
}

void BlockDecoder::Impl::ReadVertices(std::span<const std::byte> columns, std::span<glm::vec3> vertices) {
  const size_t count = vertices.size();
  const uint32_t *x = ReadColumns(columns, count), *y = x + count, *z = y + count;
  for (size_t i = 0; i < count; ++i)
    vertices[i] = {FromOrderedBits(x[i]), FromOrderedBits(y[i]), FromOrderedBits(z[i])};
}

void BlockDecoder::Impl::ReadShading(std::span<const std::byte> columns, std::span<ShadingVertex> vertices) {
  const size_t count = vertices.size();
  const uint32_t *x = ReadColumns(columns, count), *y = x + count, *z = y + count, *u = z + count,
                 *v = u + count, *color = v + count;
  for (size_t i = 0; i < count; ++i)
    vertices[i] = {{FromOrderedBits(x[i]), FromOrderedBits(y[i]), FromOrderedBits(z[i])},
                   {FromOrderedBits(u[i]), FromOrderedBits(v[i])},
                   color[i]};
}

void BlockDecoder::Impl::ReadPacked(std::span<const std::byte> columns, uint32_t kinds,
                                    std::span<ShadingVertex> vertices) {
  const size_t count = vertices.size();
  if (halves.size() < 2 * count) halves.resize(2 * count);
  const std::span<uint16_t> x(halves.data(), count), y(halves.data() + count, count);
  ReadDifferences(columns.first(2 * count), x);
  ReadDifferences(columns.subspan(2 * count, 2 * count), y);
  const uint32_t* rest = ReadColumns(columns.subspan(4 * count), count);
  const size_t u = 0, v = count, color = (kinds & kPackedUvs) != 0 ? 2 * count : 0;
  for (size_t i = 0; i < count; ++i) {
    ShadingVertex vertex;
    const uint32_t code = x[i] | uint32_t{y[i]} << 16;
    if (code != 0) vertex.normal = UnpackNormal(code);
    if ((kinds & kPackedUvs) != 0) vertex.uv = {FromOrderedBits(rest[u + i]), FromOrderedBits(rest[v + i])};
    if ((kinds & kPackedColors) != 0) vertex.color = rest[color + i];
    vertices[i] = vertex;
  }
}

Result<VoxelGeometry> BlockDecoder::Hot(std::span<const std::byte> stored, std::span<std::byte> out,
                                        float padding, std::vector<KdNode>* tree) {
  QUARRY_TRY(impl_->Decompress(stored, out.size()));
  ByteReader in(impl_->streams);
  const auto magic = in.Get<uint32_t>();
  HotCounts counts{};
  for (uint32_t* count : {&counts.triangles, &counts.vertices, &counts.references, &counts.inner_nodes,
                          &counts.node_slots, &counts.wide_nodes})
    *count = in.Get<uint32_t>();
  const Box cell{in.GetVec3<glm::vec3>(), in.GetVec3<glm::vec3>()};
  counts.masked = magic == kMaskedMagic;
  if (counts.masked) counts.fine_masks = in.Get<uint32_t>();
  if (!in.ok() || (magic != kHotMagic && !counts.masked)) return Fail("voxel block: not a hot block");
  if (!counts.sane() || counts.stream_bytes() != impl_->streams.size() ||
      counts.decoded_bytes() != out.size())
    return Fail("voxel block: counts do not fit its size");
  for (int a = 0; a < 3; ++a)
    if (!std::isfinite(cell.lower[a]) || !std::isfinite(cell.upper[a]))
      return Fail("voxel block: its cell is not finite");

  ArrayPlacer place(out);
  auto* wide = place.Next<WideNode>(counts.wide_nodes);
  auto* fine_masks = place.Next<FineMask>(counts.fine_masks);
  auto* vertices = place.Next<glm::vec3>(counts.vertices);
  auto* ids = place.Next<uint32_t>(counts.triangles);
  auto* parts = place.Next<uint32_t>(counts.triangles);
  auto* masks = place.Next<uint32_t>(counts.masks());
  auto* materials = place.Next<uint16_t>(counts.triangles);
  auto* corners = place.Next<uint16_t>(size_t{3} * counts.triangles);
  auto* references = place.Next<uint16_t>(counts.references);

  std::vector<KdNode>& nodes = tree ? *tree : impl_->nodes;
  if (tree || nodes.size() < counts.node_slots) nodes.resize(counts.node_slots);
  const std::span<KdNode> slots(nodes.data(), counts.node_slots);
  StreamCutter cut(impl_->streams, counts.header_bytes());
  const auto symbols = cut.Next(counts.nodes() * 2);
  QUARRY_TRY(impl_->tree.Read(symbols, cut.Next(size_t{counts.inner_nodes} * 4), counts.references, slots));
  impl_->ReadVertices(cut.Next(size_t{counts.vertices} * 12), {vertices, counts.vertices});
  if (!ReadFromNewest(cut.Next(size_t{counts.triangles} * 6), {corners, size_t{3} * counts.triangles},
                      counts.vertices))
    return Fail("voxel block: a corner refers beyond the vertices");
  for (uint32_t* values : {ids, parts})
    ReadDifferences(cut.Next(size_t{counts.triangles} * 4), {values, counts.triangles});
  const auto beyond = [](uint32_t part) { return (part & VoxelGeometry::kSeeThrough) != 0; };
  if (std::any_of(parts, parts + counts.triangles, beyond))
    return Fail("voxel block: it names a part beyond the limit");
  ReadPlanes<uint16_t>(cut.Next(size_t{counts.triangles} * 2), {materials, counts.triangles});
  ReadPlanes<uint32_t>(cut.Next(counts.masks() * 4), {masks, counts.masks()});
  const auto fine = cut.Next(counts.fine_masks * sizeof(FineMask));
  if (!fine.empty()) std::memcpy(fine_masks, fine.data(), fine.size());
  QUARRY_TRY(CheckMasks({masks, counts.masks()}, {fine_masks, counts.fine_masks}));
  if (!ReadFromNewest(cut.Next(size_t{counts.references} * 2), {references, counts.references},
                      counts.triangles))
    return Fail("voxel block: a reference lies beyond the triangles");

  VoxelGeometry v;
  v.nodes = tree ? slots.data() : nullptr;
  v.references = references;
  v.corners = corners;
  v.vertices = vertices;
  v.triangle_ids = ids;
  v.materials = materials;
  v.parts = parts;
  v.masks = counts.masked ? masks : nullptr;
  v.fine_masks = counts.fine_masks != 0 ? fine_masks : nullptr;
  v.wide = wide;
  v.node_count = tree ? counts.node_slots : 0;
  v.wide_count = counts.wide_nodes;
  v.reference_count = counts.references;
  v.triangle_count = counts.triangles;
  v.vertex_count = counts.vertices;
  v.fine_mask_count = counts.fine_masks;
  QUARRY_TRY(impl_->completion.Run(v, cell, padding, slots, {wide, counts.wide_nodes}));
  return v;
}

Result<VoxelShading> BlockDecoder::Shading(std::span<const std::byte> stored, std::span<std::byte> out) {
  QUARRY_TRY(impl_->Decompress(stored, out.size()));
  ByteReader in(impl_->streams);
  const auto magic = in.Get<uint32_t>();
  const auto triangles = in.Get<uint32_t>(), vertex_count = in.Get<uint32_t>();
  if (!in.ok() || (magic != kShadingMagic && magic != kPackedMagic))
    return Fail("voxel block: not a shading block");
  const bool packed = magic == kPackedMagic;
  const uint32_t columns = packed ? in.Get<uint32_t>() : 0;
  const size_t header = packed ? kPackedHeaderBytes : kShadingHeaderBytes;
  const size_t vertex_bytes = packed ? PackedVertexBytes(columns) : sizeof(ShadingVertex);
  if (!in.ok() || triangles > kMaxVoxelTriangles || vertex_count > 65535 ||
      columns > (kPackedUvs | kPackedColors) || ShadingBytes(triangles, vertex_count) != out.size() ||
      header + vertex_count * vertex_bytes + size_t{triangles} * 6 != impl_->streams.size())
    return Fail("voxel block: counts do not fit its size");
  ArrayPlacer place(out);
  auto* vertices = place.Next<ShadingVertex>(vertex_count);
  auto* corners = place.Next<uint16_t>(size_t{3} * triangles);
  StreamCutter cut(impl_->streams, header);
  if (packed)
    impl_->ReadPacked(cut.Next(vertex_count * vertex_bytes), columns, {vertices, vertex_count});
  else
    impl_->ReadShading(cut.Next(vertex_count * vertex_bytes), {vertices, vertex_count});
  if (!ReadFromNewest(cut.Next(size_t{triangles} * 6), {corners, size_t{3} * triangles}, vertex_count))
    return Fail("voxel block: a corner refers beyond the shading vertices");
  return VoxelShading{corners, vertices, triangles};
}

void MarkSeeThrough(const std::vector<Material>& materials, VoxelGeometry& hot) {
  auto* const parts = const_cast<uint32_t*>(hot.parts);
  auto* const masks = const_cast<uint32_t*>(hot.masks);
  uint32_t last = kNoIndex, mark = 0, any = 0;  // neighbours mostly share a material
  for (uint32_t i = 0; i < hot.triangle_count; ++i) {
    if (hot.materials[i] != last) {
      last = hot.materials[i];
      mark = LetsLightThrough(materials[last]) ? VoxelGeometry::kSeeThrough : 0;
    }
    const bool cut = masks && masks[i] != kOpaqueMask;
    const uint32_t passes = cut ? VoxelGeometry::kSeeThrough : mark;
    if (masks && mark != 0) masks[i] = OnlyHoles(masks[i]);
    parts[i] |= passes;
    any |= passes;
  }
  hot.has_see_through = any != 0;
}

Result<VoxelGeometry> DecodeHot(BlockDecoder& decoder, const Catalog& catalog, uint32_t voxel,
                                std::span<const std::byte> stored, std::span<std::byte> out,
                                std::vector<KdNode>* tree) {
  QUARRY_ASSIGN(VoxelGeometry hot, decoder.Hot(stored, out, catalog.meta.padding, tree));
  if (hot.triangle_count != catalog.voxels[voxel].triangles)
    return Fail("its triangles differ from the directory's");
  const auto lacks = [&](uint32_t material) { return material >= catalog.materials.size(); };
  if (std::any_of(hot.materials, hot.materials + hot.triangle_count, lacks))
    return Fail("it names a material that the scene lacks");
  MarkSeeThrough(catalog.materials, hot);
  return hot;
}

Result<VoxelShading> DecodeShading(BlockDecoder& decoder, const Catalog& catalog, uint32_t voxel,
                                   std::span<const std::byte> stored, std::span<std::byte> out) {
  QUARRY_ASSIGN(const VoxelShading shading, decoder.Shading(stored, out));
  if (shading.triangle_count != catalog.voxels[voxel].triangles)
    return Fail("its triangles differ from the directory's");
  return shading;
}

}  // namespace quarry
