#include "master/coarse_rays.h"

#include <algorithm>

#include "common/kdtree/kernels.h"
#include "common/kdtree/treelets.h"
#include "common/kdtree/wide_tree.h"

namespace quarry {
namespace {

/// The chance that a tile touches a block to which rays come only if they go as far as they may.
constexpr float kMaybe = 0.6f;
/// The chance that a ray ends in a voxel to which it comes; and what is not worth knowing. The best of those
/// tried by `quarry bench simulate` (tests/scalability).
constexpr float kEndsThere = 0.2f, kLeastWorth = 0.05f;

}  // namespace

CoarseRays::CoarseRays(const Catalog& catalog) : catalog_(catalog), seen_(catalog.voxels.size()) {
  const KdNode leaf = KdNode::Leaf(0, 0);
  const std::span<const KdNode> tree(&leaf, 1);
  const Box box{catalog.meta.root_lower, catalog.meta.root_upper};
  TreeletLayout layout(kTreeletLevels);
  nodes_.resize(layout.Slots(tree));
  layout.Run(tree, box, nodes_);
  wide_ = MakeWideTree(tree, box, kWideLeafReferences, [](const KdNode&, const Box& cell) { return cell; });
  empty_.nodes = nodes_.data();
  empty_.node_count = static_cast<uint32_t>(nodes_.size());
  empty_.wide = wide_.data();
  empty_.wide_count = static_cast<uint32_t>(wide_.size());
}

Camera CoarseRays::MakeCamera(const RenderJob& job) const {
  return {job.cameras[0], job.width, job.height, catalog_.meta.root_lower, catalog_.meta.root_upper};
}

CoarseRays::Chances CoarseRays::Blocks(const Camera& camera, const Frame::Tile& tile,
                                       std::span<const float> least, std::span<const float> most) {
  RayPacket near, far;
  uint64_t near_rays = 0, far_rays = 0;
  Chances chances;
  for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
    const uint32_t column = i % RayPacket::kSide, row = i / RayPacket::kSide;
    const double x = (column + 0.5) * tile.width / RayPacket::kSide;
    const double y = (row + 0.5) * tile.height / RayPacket::kSide;
    const auto cell = static_cast<uint32_t>(y) / kDepthCell * DepthCells(tile.width) +
                      static_cast<uint32_t>(x) / kDepthCell;
    const PrimaryRay primary = camera.Shoot(tile.x + x, tile.y + y);
    if (primary.misses) continue;
    Ray ray;
    ray.origin = primary.origin;
    ray.direction = primary.direction;
    if (most[cell] < 0) {
      // They go one by one, which takes longer: every other one of a row, and every other row.
      if (column % 2 == 0 && row % 2 == 0) AddUnknown(ray, chances);
      continue;
    }
    const auto add = [&](RayPacket& packet, uint64_t& rays, float depth) {
      ray.t_max = depth - primary.t_offset;
      if (ray.t_max <= 0) return;
      packet.Set(i, ray);
      rays |= uint64_t{1} << i;
    };
    add(far, far_rays, most[cell]);
    add(near, near_rays, least[cell]);
  }
  AddPacket(far, far_rays, kMaybe, chances);
  AddPacket(near, near_rays, 1, chances);
  return chances;
}

void CoarseRays::AddPacket(RayPacket& packet, uint64_t active, float chance, Chances& chances) {
  for (const uint32_t voxel : Trace(packet, active)) {
    float& known = chances[BlockId(voxel, BlockKind::kHot)];
    known = std::max(known, chance);
  }
}

void CoarseRays::AddUnknown(const Ray& ray, Chances& chances) {
  RayPacket packet;
  packet.Set(0, ray);
  float chance = 1;
  for (const uint32_t voxel : Trace(packet, 1)) {
    float& known = chances[BlockId(voxel, BlockKind::kHot)];
    known = std::max(known, chance);
    chance *= 1 - kEndsThere;
    if (chance < kLeastWorth) return;
  }
}

std::span<const uint32_t> CoarseRays::Trace(RayPacket& packet, uint64_t active) {
  found_.clear();
  const VoxelFinder finder{[](void* self, uint32_t voxel) -> const VoxelGeometry* {
                             auto& rays = *static_cast<CoarseRays*>(self);
                             if (!rays.seen_[voxel]) rays.found_.push_back(voxel);
                             rays.seen_[voxel] = true;
                             return &rays.empty_;
                           },
                           this};
  TraceRays(catalog_.top_tree(), finder, &packet, &active, 1, false);
  for (const uint32_t voxel : found_) seen_[voxel] = false;
  return found_;
}

}  // namespace quarry
