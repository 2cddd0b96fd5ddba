#include "preprocess/partition.h"

#include <algorithm>
#include <cstring>
#include <glm/common.hpp>
#include <limits>
#include <numeric>
#include <optional>

#include "common/kdtree/ray.h"
#include "common/math/next_float.h"
#include "preprocess/split.h"
#include "preprocess/voxel_builder.h"

namespace quarry {
namespace {

constexpr int kMaxDepth = 64;
constexpr float kEmptyFraction = 0.1f;  // of a voxel's extent: less empty space is not worth a node
/// Long slivers lie in both halves of every split: beyond this growth along one path they are chained
/// instead, so that no input makes the store explode.
constexpr double kMaxGrowth = 10;

Box EmptyBox() { return {glm::vec3(kInfinity), glm::vec3(-kInfinity)}; }

/// The part of `box` inside `cell` joined to `content`.
void IncludeClipped(const Box& box, const Box& cell, Box& content) {
  content.Include(glm::max(box.lower, cell.lower));
  content.Include(glm::min(box.upper, cell.upper));
}

class Partitioner {
 public:
  Partitioner(bool has_shading, float padding, const PartitionOptions& options,
              const std::function<Status(VoxelTask)>& emit)
      : has_shading_(has_shading),
        padding_(padding),
        options_(options),
        emit_(emit),
        max_triangles_(MaxTrianglesPerVoxel(options.voxel_size)) {}

  /// A node whose triangles lie on disk. `file` is freed before its children are split.
  Status SplitFile(uint32_t node, SpillFile file, const Box& cell, const Box& content, int depth,
                   double growth) {
    if (file.count() * (sizeof(TriangleRecord) + sizeof(Box)) <= options_.memory / 4 ||
        file.count() <= max_triangles_)
      return LoadAndSplit(node, std::move(file), cell, content, depth, growth);
    SplitHistogram histogram(content);
    QUARRY_TRY(ForEach(file, [&](const TriangleRecord& r) -> Status {
      histogram.Add(r.PaddedBox(padding_));
      return Status{};
    }));
    const auto plane = histogram.Choose(cell);
    if (MustChain(plane, depth, growth)) return ChainFile(node, file, cell, content);

    Children child(*this, node, plane, cell);
    std::optional<SpillFile> files[2];
    for (auto& f : files) {
      QUARRY_ASSIGN(f, SpillFile::Create(options_.tmp_folder, RecordBytes(has_shading_)));
    }
    QUARRY_TRY(ForEach(file, [&](const TriangleRecord& r) -> Status {
      const Box box = r.PaddedBox(padding_);
      for (int side = 0; side < 2; ++side) {
        if (!child.Touches(box, side)) continue;
        IncludeClipped(box, child.cell[side], child.content[side]);
        QUARRY_TRY(files[side]->Append(&r));
      }
      return Status{};
    }));
    { const SpillFile consumed = std::move(file); }
    for (auto& f : files) QUARRY_TRY(f->FinishWriting());
    for (uint32_t side = 0; side < 2; ++side)
      QUARRY_TRY(SplitFile(child.first + side, std::move(*files[side]), child.cell[side], child.content[side],
                           depth + 1, growth * plane.growth));
    return {};
  }

  std::vector<KdNode>& nodes() { return nodes_; }

 private:
  /// A node's triangles in memory, and their padded boxes.
  struct Loaded {
    std::vector<TriangleRecord> records;
    std::vector<Box> boxes;
  };

  /// The two halves of a node about to be split.
  struct Children {
    Children(Partitioner& p, uint32_t node, const SplitHistogram::Plane& plane, const Box& whole)
        : axis(plane.axis), position(plane.position), first(static_cast<uint32_t>(p.nodes_.size())) {
      p.nodes_[node] = KdNode::Inner(axis, position, first);
      p.nodes_.resize(first + 2);
      cell[0] = cell[1] = whole;
      cell[0].upper[axis] = cell[1].lower[axis] = position;
      content[0] = content[1] = EmptyBox();
    }
    bool Touches(const Box& box, int side) const {
      return side == 0 ? box.lower[axis] <= position : box.upper[axis] >= position;
    }
    int axis;
    float position;
    uint32_t first;
    Box cell[2], content[2];
  };

  static bool MustChain(const SplitHistogram::Plane& plane, int depth, double growth) {
    return plane.axis < 0 || depth == kMaxDepth || growth * plane.growth > kMaxGrowth;
  }

  template <class Visit>
  Status ForEach(const SpillFile& file, Visit&& visit) {
    SpillReader reader(file);
    while (const std::byte* bytes = reader.Next()) {
      TriangleRecord record;
      std::memcpy(&record, bytes, file.element_bytes());
      QUARRY_TRY(visit(record));
    }
    return reader.status();
  }

  Status LoadAndSplit(uint32_t node, SpillFile file, const Box& cell, const Box& content, int depth,
                      double growth) {
    Loaded loaded;
    loaded.records.reserve(file.count());
    loaded.boxes.reserve(file.count());
    QUARRY_TRY(ForEach(file, [&](const TriangleRecord& r) -> Status {
      loaded.records.push_back(r);
      loaded.boxes.push_back(r.PaddedBox(padding_));
      return Status{};
    }));
    { const SpillFile consumed = std::move(file); }
    std::vector<uint32_t> all(loaded.records.size());
    std::iota(all.begin(), all.end(), 0u);
    return SplitInMemory(node, loaded, std::move(all), cell, content, depth, growth);
  }

  Status SplitInMemory(uint32_t node, const Loaded& loaded, std::vector<uint32_t> indices, const Box& cell,
                       const Box& content, int depth, double growth) {
    if (indices.empty()) {
      nodes_[node] = KdNode::Leaf(0, 0);
      return {};
    }
    SplitHistogram::Plane plane;
    const bool small = indices.size() <= max_triangles_;
    if (!small) {
      SplitHistogram histogram(content);
      for (uint32_t i : indices) histogram.Add(loaded.boxes[i]);
      plane = histogram.Choose(cell);
    }
    if (small || MustChain(plane, depth, growth)) return Chain(node, loaded.records, indices, cell, content);

    Children child(*this, node, plane, cell);
    std::vector<uint32_t> parts[2];
    for (uint32_t i : indices) {
      const Box& box = loaded.boxes[i];
      for (int side = 0; side < 2; ++side) {
        if (!child.Touches(box, side)) continue;
        IncludeClipped(box, child.cell[side], child.content[side]);
        parts[side].push_back(i);
      }
    }
    indices = {};
    for (uint32_t side = 0; side < 2; ++side)
      QUARRY_TRY(SplitInMemory(child.first + side, loaded, std::move(parts[side]), child.cell[side],
                               child.content[side], depth + 1, growth * plane.growth));
    return {};
  }

  /// Cuts off the empty space around the content, so that rays that pass through it need no voxel: `cell`
  /// becomes what is left. Returns the node that is left.
  uint32_t Trim(uint32_t node, Box& cell, const Box& content) {
    for (int face = 0; face < 6; ++face) {
      const int axis = face / 2;
      const bool upper = face % 2 != 0;
      const float gap =
          upper ? cell.upper[axis] - content.upper[axis] : content.lower[axis] - cell.lower[axis];
      if (!(gap > kEmptyFraction * cell.extent(axis))) continue;
      const float plane = upper ? NextAbove(content.upper[axis]) : NextBelow(content.lower[axis]);
      const auto first = static_cast<uint32_t>(nodes_.size());
      nodes_[node] = KdNode::Inner(axis, plane, first);
      nodes_.resize(first + 2);  // empty leaves
      node = first + (upper ? 0 : 1);
      (upper ? cell.upper : cell.lower)[axis] = plane;
    }
    return node;
  }

  /// One voxel, or several in a chain for a pile that no plane parts.
  Status Chain(uint32_t node, const std::vector<TriangleRecord>& records,
               const std::vector<uint32_t>& indices, Box cell, const Box& content) {
    nodes_[Trim(node, cell, content)] = KdNode::Leaf(voxels_, 1);
    for (size_t i = 0; i < indices.size(); i += max_triangles_) {
      const size_t end = std::min<size_t>(i + max_triangles_, indices.size());
      VoxelTask task;
      task.cell = cell;
      task.chained = end < indices.size();
      for (size_t k = i; k < end; ++k) task.triangles.push_back(records[indices[k]]);
      QUARRY_TRY(Emit(std::move(task)));
    }
    return {};
  }

  /// The same, from disk.
  Status ChainFile(uint32_t node, const SpillFile& file, Box cell, const Box& content) {
    nodes_[Trim(node, cell, content)] = KdNode::Leaf(voxels_, 1);
    VoxelTask task;
    uint64_t left = file.count();
    QUARRY_TRY(ForEach(file, [&](const TriangleRecord& r) -> Status {
      task.triangles.push_back(r);
      --left;
      if (left > 0 && task.triangles.size() < max_triangles_) return Status{};
      task.cell = cell;
      task.chained = left > 0;
      return Emit(std::exchange(task, {}));
    }));
    return {};
  }

  Status Emit(VoxelTask task) {
    ++voxels_;
    return emit_(std::move(task));
  }

  const bool has_shading_;
  const float padding_;
  const PartitionOptions& options_;
  const std::function<Status(VoxelTask)>& emit_;
  const uint32_t max_triangles_;
  uint32_t voxels_ = 0;
  std::vector<KdNode> nodes_{1};
};

}  // namespace

Result<std::vector<KdNode>> Partition(SpillFile triangles, bool has_shading, const Box& root,
                                      const Box& content, float padding, const PartitionOptions& options,
                                      const std::function<Status(VoxelTask)>& emit) {
  Partitioner partitioner(has_shading, padding, options, emit);
  QUARRY_TRY(partitioner.SplitFile(0, std::move(triangles), root, content, 0, 1));
  return std::move(partitioner.nodes());
}

}  // namespace quarry
