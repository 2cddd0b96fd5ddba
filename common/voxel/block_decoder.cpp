#include "common/voxel/block_decoder.h"

#include <lz4.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "common/kdtree/treelets.h"
#include "common/kdtree/wide_tree.h"
#include "common/voxel/byte_planes.h"

namespace quarry {
namespace {

// --- the hot block's counts, from which all sizes follow

struct HotCounts {
  uint32_t triangles, vertices, references, inner_nodes, node_slots, wide_nodes;

  size_t nodes() const { return size_t{2} * inner_nodes + 1; }
  size_t stream_bytes() const {
    return kHotHeaderBytes + nodes() * 2 + size_t{inner_nodes} * 4 + size_t{vertices} * 12 +
           size_t{triangles} * (6 + 4 + 4 + 2) + size_t{references} * 2;
  }
  size_t decoded_bytes() const { return HotBytes(node_slots, wide_nodes, references, triangles, vertices); }
  /// Each small enough that sums of sizes cannot overflow.
  bool sane() const {
    return triangles <= kMaxVoxelTriangles && vertices <= 65535 && references <= kMaxBlockBytes / 2 &&
           inner_nodes <= kMaxBlockBytes / 8 && node_slots <= kMaxBlockBytes / 8 &&
           wide_nodes <= kMaxBlockBytes / sizeof(WideNode) && nodes() < node_slots;
  }
};

/// Takes the streams of a block one after the other; their sizes were checked against the whole before.
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

/// Lays arrays out one behind the other in a decoded block.
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

// --- decoding: derived parts

/// A vertex, and what follows it, as the compiler's own vector.
using Float4 = float __attribute__((vector_size(16)));

Float4 LoadFour(const glm::vec3& v) {
  Float4 four;
  std::memcpy(&four, &v, sizeof four);
  return four;
}
Float4 Less(Float4 a, Float4 b) { return a < b ? a : b; }
Float4 More(Float4 a, Float4 b) { return a > b ? a : b; }

struct Box4 {
  Float4 lower, upper;
};

}  // namespace

struct BlockDecoder::Impl {
  Bytes streams;
  std::vector<uint16_t> symbol;
  std::vector<uint32_t> plane, column;
  TreeletLayout layout{kTreeletLevels};
  std::vector<KdNode> tree;  // root first, children side by side
  /// Where right children are to come, and their cells.
  std::vector<uint32_t> right_next;
  std::vector<Box> right_cells;
  std::vector<Box4> boxes;  // of triangles
  WideTreeMaker wide{kWideLeafReferences};

  Status Decompress(std::span<const std::byte> stored, size_t most);
  Status ReadTree(const HotCounts& counts, std::span<const std::byte> symbols,
                  std::span<const std::byte> planes);
  Status FillWideNodes(const VoxelGeometry& v, const Box& cell, float padding, WideNode* out);
};

BlockDecoder::BlockDecoder() : impl_(std::make_unique<Impl>()) {}
BlockDecoder::~BlockDecoder() = default;

Status BlockDecoder::Impl::Decompress(std::span<const std::byte> stored, size_t most) {
  ByteReader in(stored);
  const auto size = in.Get<uint32_t>();
  const auto packed = in.GetSpan(in.remaining());
  if (!in.ok() || size > most + kMostStoredOverDecoded)
    return Fail("voxel block: more bytes than the directory's entry allows");
  streams.resize(size);
  if (packed.size() == size) {
    std::ranges::copy(packed, streams.begin());
    return {};
  }
  const int got = LZ4_decompress_safe(reinterpret_cast<const char*>(packed.data()),
                                      reinterpret_cast<char*>(streams.data()),
                                      static_cast<int>(packed.size()), static_cast<int>(size));
  if (got < 0 || static_cast<size_t>(got) != size) return Fail("voxel block: LZ4 finds no such bytes in it");
  return {};
}

Status BlockDecoder::Impl::ReadTree(const HotCounts& counts, std::span<const std::byte> symbols,
                                    std::span<const std::byte> planes) {
  symbol.resize(counts.nodes());
  plane.resize(counts.inner_nodes);
  ReadPlanes<uint16_t>(symbols, symbol);
  ReadPlanes<uint32_t>(planes, plane);
  tree.resize(counts.nodes());
  right_next.clear();
  uint32_t inner = 0, next = 1, at = 0, last[3] = {};
  uint64_t references = 0;
  for (size_t i = 0; i < counts.nodes(); ++i) {
    const uint32_t s = symbol[i];
    if (s < kLeafSymbol) {
      if (inner == counts.inner_nodes) return Fail("voxel block: more inner nodes than it has");
      last[s] += UndoZigZag(plane[inner++]);
      const float split = FromOrderedBits(last[s]);
      if (!std::isfinite(split)) return Fail("voxel block: a plane is not finite");
      tree[at] = KdNode::Inner(static_cast<int>(s), split, next);
      right_next.push_back(next + 1);
      at = next;
      next += 2;
      continue;
    }
    const uint32_t count = s - kLeafSymbol;
    tree[at] = KdNode::Leaf(count == 0 ? 0 : static_cast<uint32_t>(references), count);
    references += count;
    if (right_next.empty()) {
      // So many leaves were there as inner nodes and one: all nodes have come.
      if (i + 1 != counts.nodes()) return Fail("voxel block: nodes beyond the tree");
      break;
    }
    at = right_next.back();
    right_next.pop_back();
  }
  if (!right_next.empty() || inner != counts.inner_nodes) return Fail("voxel block: the tree has no end");
  if (references != counts.references) return Fail("voxel block: leaves have not the references there are");
  return {};
}

Status BlockDecoder::Impl::FillWideNodes(const VoxelGeometry& v, const Box& cell, float padding,
                                         WideNode* out) {
  boxes.resize(v.triangle_count);
  for (uint32_t t = 0; t < v.triangle_count; ++t) {
    const Float4 a = LoadFour(v.vertex(t, 0)), b = LoadFour(v.vertex(t, 1)), c = LoadFour(v.vertex(t, 2));
    boxes[t] = {Less(Less(a, b), c) - padding, More(More(a, b), c) + padding};
  }
  right_next.clear();
  right_cells.clear();
  Box here = cell;
  for (uint32_t at = 0;;) {
    const KdNode& n = tree[at];
    if (!n.is_leaf()) {
      wide.Inner();
      right_next.push_back(n.left() + 1);
      right_cells.push_back(here);
      right_cells.back().lower[n.axis()] = n.split();
      here.upper[n.axis()] = n.split();
      at = n.left();
      continue;
    }
    Box box = here;
    if (n.count() != 0) {
      const uint16_t* reference = v.references + n.first();
      Box4 all = boxes[reference[0]];
      for (uint32_t r = 1; r < n.count(); ++r) {
        all.lower = Less(all.lower, boxes[reference[r]].lower);
        all.upper = More(all.upper, boxes[reference[r]].upper);
      }
      for (int a = 0; a < 3; ++a) {
        box.lower[a] = std::max(all.lower[a], here.lower[a]);
        box.upper[a] = std::min(all.upper[a], here.upper[a]);
      }
    }
    wide.Leaf(box, n.first(), n.count());
    if (right_next.empty()) break;
    at = right_next.back();
    here = right_cells.back();
    right_next.pop_back();
    right_cells.pop_back();
  }
  const std::span<const WideNode> made = wide.Finish();
  if (made.size() != v.wide_count) return Fail("voxel block: not as many wide nodes as its tree has");
  std::ranges::copy(made, out);
  return {};
}

Result<VoxelGeometry> BlockDecoder::Hot(std::span<const std::byte> stored, std::span<std::byte> out,
                                        float padding) {
  QUARRY_TRY(impl_->Decompress(stored, out.size()));
  ByteReader in(impl_->streams);
  const auto magic = in.Get<uint32_t>();
  HotCounts counts{};
  for (uint32_t* count : {&counts.triangles, &counts.vertices, &counts.references, &counts.inner_nodes,
                          &counts.node_slots, &counts.wide_nodes})
    *count = in.Get<uint32_t>();
  const Box cell{in.GetVec3<glm::vec3>(), in.GetVec3<glm::vec3>()};
  if (!in.ok() || magic != kHotMagic) return Fail("voxel block: not a hot block");
  if (!counts.sane() || counts.stream_bytes() != impl_->streams.size() ||
      counts.decoded_bytes() != out.size())
    return Fail("voxel block: counts do not fit its size");
  for (int a = 0; a < 3; ++a)
    if (!std::isfinite(cell.lower[a]) || !std::isfinite(cell.upper[a]))
      return Fail("voxel block: its cell is not finite");

  ArrayPlacer place(out);
  auto* wide = place.Next<WideNode>(counts.wide_nodes);
  auto* nodes = place.Next<KdNode>(counts.node_slots);
  auto* vertices = place.Next<glm::vec3>(counts.vertices);
  auto* ids = place.Next<uint32_t>(counts.triangles);
  auto* parts = place.Next<uint32_t>(counts.triangles);
  auto* materials = place.Next<uint16_t>(counts.triangles);
  auto* corners = place.Next<uint16_t>(size_t{3} * counts.triangles);
  auto* references = place.Next<uint16_t>(counts.references);

  StreamCutter cut(impl_->streams, kHotHeaderBytes);
  const auto symbols = cut.Next(counts.nodes() * 2);
  QUARRY_TRY(impl_->ReadTree(counts, symbols, cut.Next(size_t{counts.inner_nodes} * 4)));
  impl_->column.resize(counts.vertices);
  for (int a = 0; a < 3; ++a) {
    ReadDifferences<uint32_t>(cut.Next(size_t{counts.vertices} * 4), impl_->column);
    for (uint32_t i = 0; i < counts.vertices; ++i) vertices[i][a] = FromOrderedBits(impl_->column[i]);
  }
  if (!ReadFromNewest(cut.Next(size_t{counts.triangles} * 6), {corners, size_t{3} * counts.triangles},
                      counts.vertices))
    return Fail("voxel block: a corner goes beyond the vertices");
  for (uint32_t* values : {ids, parts})
    ReadDifferences<uint32_t>(cut.Next(size_t{counts.triangles} * 4), {values, counts.triangles});
  ReadPlanes<uint16_t>(cut.Next(size_t{counts.triangles} * 2), {materials, counts.triangles});
  if (!ReadFromNewest(cut.Next(size_t{counts.references} * 2), {references, counts.references},
                      counts.triangles))
    return Fail("voxel block: a reference goes beyond the triangles");

  VoxelGeometry v;
  v.nodes = nodes;
  v.references = references;
  v.corners = corners;
  v.vertices = vertices;
  v.triangle_ids = ids;
  v.materials = materials;
  v.parts = parts;
  v.wide = wide;
  v.node_count = counts.node_slots;
  v.wide_count = counts.wide_nodes;
  v.reference_count = counts.references;
  v.triangle_count = counts.triangles;
  v.vertex_count = counts.vertices;
  if (!impl_->layout.Run(impl_->tree, cell, {nodes, counts.node_slots}))
    return Fail("voxel block: not as many node slots as its tree takes");
  QUARRY_TRY(impl_->FillWideNodes(v, cell, padding, wide));
  return v;
}

Result<VoxelShading> BlockDecoder::Shading(std::span<const std::byte> stored, std::span<std::byte> out) {
  QUARRY_TRY(impl_->Decompress(stored, out.size()));
  ByteReader in(impl_->streams);
  const auto magic = in.Get<uint32_t>();
  const auto triangles = in.Get<uint32_t>(), vertex_count = in.Get<uint32_t>();
  if (!in.ok() || magic != kShadingMagic) return Fail("voxel block: not a shading block");
  if (triangles > kMaxVoxelTriangles || vertex_count > 65535 ||
      ShadingBytes(triangles, vertex_count) != out.size() ||
      kShadingHeaderBytes + out.size() != impl_->streams.size())
    return Fail("voxel block: counts do not fit its size");
  ArrayPlacer place(out);
  auto* vertices = place.Next<ShadingVertex>(vertex_count);
  auto* corners = place.Next<uint16_t>(size_t{3} * triangles);
  StreamCutter cut(impl_->streams, kShadingHeaderBytes);
  impl_->column.resize(vertex_count);
  const auto read = [&](auto&& put) {
    ReadDifferences<uint32_t>(cut.Next(size_t{vertex_count} * 4), impl_->column);
    for (uint32_t i = 0; i < vertex_count; ++i) put(vertices[i], impl_->column[i]);
  };
  for (int a = 0; a < 3; ++a)
    read([a](ShadingVertex& v, uint32_t value) { v.normal[a] = FromOrderedBits(value); });
  for (int a = 0; a < 2; ++a)
    read([a](ShadingVertex& v, uint32_t value) { v.uv[a] = FromOrderedBits(value); });
  read([](ShadingVertex& v, uint32_t value) { v.color = value; });
  if (!ReadFromNewest(cut.Next(size_t{triangles} * 6), {corners, size_t{3} * triangles}, vertex_count))
    return Fail("voxel block: a corner goes beyond the shading vertices");
  return VoxelShading{corners, vertices, triangles};
}

}  // namespace quarry
