#include "common/engine/framing_bulk.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vector_relational.hpp>
#include <iterator>

#include "common/math/elementary.h"

namespace quarry {
namespace {

/// Triangles that may lie outside the bulk at either end of an axis, as a share of all.
constexpr double kStrays = 0.005;
/// Along an axis the bulk is as long as the box of all triangles unless that is so many times as long.
constexpr double kFarLarger = 2;
/// So many voxels, those of the largest cells, are measured by their triangles, the others by their cells: a
/// plate or a backdrop makes the cells large that it crosses.
constexpr size_t kFewVoxels = 32;
/// Directions in which the hull has points.
constexpr int kHullDirections = 256;

/// A voxel and its place: its leaf's cell, cut down to its triangles.
struct PlacedVoxel {
  uint32_t voxel;
  WeightedBox cell;
};

std::vector<PlacedVoxel> CellsOf(const Catalog& catalog) {
  struct Open {
    uint32_t node;
    glm::vec3 lower, upper;
  };
  std::vector<PlacedVoxel> cells;
  std::vector<Open> open{{0, catalog.meta.root_lower, catalog.meta.root_upper}};
  while (!open.empty()) {
    const Open cell = open.back();
    open.pop_back();
    const KdNode& node = catalog.top_nodes[cell.node];
    if (!node.is_leaf()) {
      Open left = cell, right = cell;
      left.node = node.left();
      right.node = node.left() + 1;
      left.upper[node.axis()] = right.lower[node.axis()] = node.split();
      open.push_back(left);
      open.push_back(right);
      continue;
    }
    if (node.count() == 0) continue;
    for (uint32_t v = node.first(); v < catalog.chain_end[node.first()]; ++v) {
      const VoxelEntry& voxel = catalog.voxels[v];
      cells.push_back({v,
                       {glm::max(cell.lower, voxel.bounds_lower), glm::min(cell.upper, voxel.bounds_upper),
                        static_cast<double>(voxel.triangles)}});
    }
  }
  return cells;
}

/// The place along an axis below which a share of the weight lies, spread evenly over each box.
double Quantile(const std::vector<WeightedBox>& boxes, int axis, double share) {
  double all = 0, low = 1e300, high = -1e300;
  for (const WeightedBox& box : boxes) {
    all += box.weight;
    low = std::min(low, static_cast<double>(box.lower[axis]));
    high = std::max(high, static_cast<double>(box.upper[axis]));
  }
  for (int step = 0; step < 40; ++step) {
    const double middle = (low + high) / 2;
    double below = 0;
    for (const WeightedBox& box : boxes) {
      const double length = static_cast<double>(box.upper[axis]) - static_cast<double>(box.lower[axis]);
      const double inside = middle - static_cast<double>(box.lower[axis]);
      below += box.weight * (length > 0 ? std::clamp(inside / length, 0.0, 1.0) : inside >= 0 ? 1.0 : 0.0);
    }
    (below < share * all ? low : high) = middle;
  }
  return (low + high) / 2;
}

/// Cuts the bulk along an axis where all boxes take far more of it than nearly all triangles do: to those
/// boxes that lie near these.
void MeasureBulk(const std::vector<WeightedBox>& boxes, int axis, Framing& framing) {
  constexpr double kFew = 16;  // triangles of which none is a stray
  double all = 0;
  for (const WeightedBox& box : boxes) all += box.weight;
  const double strays = all < kFew ? kStrays : std::max(kStrays, 1.01 / all);
  const double lower = Quantile(boxes, axis, strays), upper = Quantile(boxes, axis, 1 - strays);
  if (framing.upper[axis] - framing.lower[axis] <= kFarLarger * (upper - lower)) return;
  const double near = (kFarLarger - 1) / 2 * (upper - lower);
  double least = upper, most = lower;
  for (const WeightedBox& box : boxes) {
    const auto from = static_cast<double>(box.lower[axis]), to = static_cast<double>(box.upper[axis]);
    if (from < lower - near || to > upper + near) continue;
    least = std::min(least, from);
    most = std::max(most, to);
  }
  framing.lower[axis] = std::min(least, lower);
  framing.upper[axis] = std::max(most, upper);
}

/// The boxes that lie in the bulk; all, where none does.
std::vector<WeightedBox> Within(const std::vector<WeightedBox>& boxes, const Framing& bulk) {
  std::vector<WeightedBox> within;
  std::ranges::copy_if(boxes, std::back_inserter(within), [&](const WeightedBox& box) {
    return glm::all(glm::greaterThanEqual(glm::dvec3(box.lower), bulk.lower)) &&
           glm::all(glm::lessThanEqual(glm::dvec3(box.upper), bulk.upper));
  });
  return within.empty() ? boxes : within;
}

}  // namespace

Result<DecodedVoxel> DecodeVoxel(const Scene& scene, uint32_t voxel, BlockDecoder& decoder) {
  const Catalog& catalog = scene.catalog();
  QUARRY_ASSIGN(const Bytes stored, scene.store().ReadBlock(BlockKey::Hot(voxel)));
  DecodedVoxel decoded;
  decoded.memory.resize(catalog.block(BlockKey::Hot(voxel)).decoded);
  QUARRY_ASSIGN(decoded.geometry, DecodeHot(decoder, catalog, voxel, stored, decoded.memory));
  return decoded;
}

Result<std::vector<WeightedBox>> BoxesOf(const Scene& scene) {
  std::vector<PlacedVoxel> cells = CellsOf(scene.catalog());
  const auto size = [](const PlacedVoxel& v) { return glm::distance(v.cell.lower, v.cell.upper); };
  std::ranges::sort(cells, [&](const PlacedVoxel& a, const PlacedVoxel& b) {
    return size(a) != size(b) ? size(a) > size(b) : a.voxel < b.voxel;
  });
  std::vector<WeightedBox> boxes;
  BlockDecoder decoder;
  for (size_t i = 0; i < cells.size(); ++i) {
    const auto& [v, cell] = cells[i];
    if (i >= kFewVoxels) {
      boxes.push_back(cell);
      continue;
    }
    QUARRY_ASSIGN(const DecodedVoxel voxel, DecodeVoxel(scene, v, decoder));
    for (uint32_t t = 0; t < scene.catalog().voxels[v].triangles; ++t) {
      const glm::vec3 a = voxel.geometry.vertex(t, 0), b = voxel.geometry.vertex(t, 1),
                      c = voxel.geometry.vertex(t, 2);
      // The rest of a triangle lies in other voxels.
      const glm::vec3 lower = glm::max(glm::min(a, glm::min(b, c)), cell.lower),
                      upper = glm::min(glm::max(a, glm::max(b, c)), cell.upper);
      boxes.push_back({lower, glm::max(lower, upper), 1});
    }
  }
  return boxes;
}

void MeasureBulk(const std::vector<WeightedBox>& boxes, const SceneMeta& meta, Framing& framing) {
  framing.lower = glm::dvec3(meta.bounds_lower);
  framing.upper = glm::dvec3(meta.bounds_upper);
  for (int a = 0; a < 3; ++a) MeasureBulk(boxes, a, framing);
  std::vector<glm::vec3> corners;
  for (const WeightedBox& box : boxes) {
    const glm::dvec3 from = glm::max(glm::dvec3(box.lower), framing.lower),
                     to = glm::min(glm::dvec3(box.upper), framing.upper);
    if (from.x > to.x || from.y > to.y || from.z > to.z) continue;
    for (int corner = 0; corner < 8; ++corner)
      corners.emplace_back(corner & 1 ? to.x : from.x, corner & 2 ? to.y : from.y,
                           corner & 4 ? to.z : from.z);
  }
  if (corners.empty()) corners = {glm::vec3(framing.lower), glm::vec3(framing.upper)};
  // The farthest point in each of many directions spread over the sphere (a Fibonacci lattice).
  for (int i = 0; i < kHullDirections; ++i) {
    const double z = 1 - (2 * i + 1) / static_cast<double>(kHullDirections), radius = std::sqrt(1 - z * z);
    double sine = 0, cosine = 1;
    SinCos(i * 2.39996322972865332223, sine, cosine);  // the golden angle
    const glm::vec3 direction(static_cast<float>(radius * cosine), static_cast<float>(radius * sine),
                              static_cast<float>(z));
    framing.hull.push_back(
        *std::ranges::max_element(corners, {}, [&](const glm::vec3& p) { return glm::dot(p, direction); }));
  }
}

Core MeasureCore(const std::vector<WeightedBox>& all, const Framing& bulk) {
  const std::vector<WeightedBox> boxes = Within(all, bulk);
  constexpr double kOutside = 0.02;
  Core core;
  for (int a = 0; a < 3; ++a) {
    core.lower[a] = Quantile(boxes, a, kOutside);
    core.middle[a] = Quantile(boxes, a, 0.5);
    core.upper[a] = Quantile(boxes, a, 1 - kOutside);
  }
  return core;
}

}  // namespace quarry
