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
constexpr double kFarLarger = 3;
/// Boxes that lie so near nearly all triangles, as a share of their length, belong to the bulk.
constexpr double kNear = 1;
/// So many voxels of the largest cells are measured by their triangles, the others by their cells. A plate or
/// a backdrop enlarges the cells that it crosses.
constexpr size_t kFewVoxels = 32;
/// Triangles of a voxel above which they are gathered, and the grids that may lie in one another.
constexpr size_t kManyTriangles = 512;
constexpr int kGrids = 6;
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

/// Gathers the boxes of a voxel's triangles: boxes are joined whose middles lie in one cell of a grid over
/// them. A triangle longer than two cells stays alone. A cell that holds more than an eighth of the triangles
/// gets a grid of its own, since strays can make the first grid far coarser than the model.
void Gather(std::vector<WeightedBox> boxes, size_t crowd, int levels, std::vector<WeightedBox>& gathered) {
  constexpr int kSide = 8;
  WeightedBox bounds = boxes.front();
  for (const WeightedBox& box : boxes) {
    bounds.lower = glm::min(bounds.lower, box.lower);
    bounds.upper = glm::max(bounds.upper, box.upper);
  }
  const glm::vec3 step = (bounds.upper - bounds.lower) / static_cast<float>(kSide);
  std::vector<std::vector<WeightedBox>> cells(size_t{kSide} * kSide * kSide);
  for (const WeightedBox& box : boxes) {
    if (glm::any(glm::greaterThan(box.upper - box.lower, 2.0f * step))) {
      gathered.push_back(box);
      continue;
    }
    size_t at = 0;
    for (int a = 0; a < 3; ++a) {
      const float place = ((box.lower[a] + box.upper[a]) / 2 - bounds.lower[a]) / step[a];
      const int index = place > 0 ? std::min(static_cast<int>(place), kSide - 1) : 0;  // NaN: no extent
      at = at * kSide + static_cast<size_t>(index);
    }
    cells[at].push_back(box);
  }
  for (std::vector<WeightedBox>& cell : cells) {
    if (cell.empty()) continue;
    if (cell.size() > crowd && levels > 1) {
      Gather(std::move(cell), crowd, levels - 1, gathered);
      continue;
    }
    WeightedBox all = cell.front();
    for (size_t i = 1; i < cell.size(); ++i) {
      all.lower = glm::min(all.lower, cell[i].lower);
      all.upper = glm::max(all.upper, cell[i].upper);
      all.weight += cell[i].weight;
    }
    gathered.push_back(all);
  }
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

/// Cuts the bulk along an axis where all boxes are far longer than the range of nearly all triangles: to the
/// boxes near that range.
void MeasureBulk(const std::vector<WeightedBox>& boxes, int axis, Framing& framing) {
  constexpr double kFew = 16;  // triangles of which none is a stray
  double all = 0;
  for (const WeightedBox& box : boxes) all += box.weight;
  const double strays = all < kFew ? kStrays : std::max(kStrays, 1.01 / all);
  const double lower = Quantile(boxes, axis, strays), upper = Quantile(boxes, axis, 1 - strays);
  if (framing.upper[axis] - framing.lower[axis] <= kFarLarger * (upper - lower)) return;
  const double near = kNear * (upper - lower);
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
    std::vector<WeightedBox> triangles;
    for (uint32_t t = 0; t < scene.catalog().voxels[v].triangles; ++t) {
      const glm::vec3 a = voxel.geometry.vertex(t, 0), b = voxel.geometry.vertex(t, 1),
                      c = voxel.geometry.vertex(t, 2);
      triangles.push_back({glm::min(a, glm::min(b, c)), glm::max(a, glm::max(b, c)), 1});
    }
    if (triangles.size() <= kManyTriangles) {
      std::ranges::copy(triangles, std::back_inserter(boxes));
    } else {
      const size_t crowd = triangles.size() / 8;
      Gather(std::move(triangles), crowd, kGrids, boxes);
    }
  }
  return boxes;
}

void MeasureBulk(const std::vector<WeightedBox>& boxes, const SceneMeta& meta, Framing& framing) {
  framing.lower = glm::dvec3(meta.bounds_lower);
  framing.upper = glm::dvec3(meta.bounds_upper);
  for (int a = 0; a < 3; ++a) MeasureBulk(boxes, a, framing);
  std::vector<WeightedBox> parts;
  for (const WeightedBox& box : boxes) {
    const glm::dvec3 from = glm::max(glm::dvec3(box.lower), framing.lower),
                     to = glm::min(glm::dvec3(box.upper), framing.upper);
    if (glm::all(glm::lessThanEqual(from, to))) parts.push_back({glm::vec3(from), glm::vec3(to), 1});
  }
  if (parts.empty()) parts = {{glm::vec3(framing.lower), glm::vec3(framing.upper), 1}};
  // The farthest point in each of many directions spread over the sphere (a Fibonacci lattice).
  for (int i = 0; i < kHullDirections; ++i) {
    const double z = 1 - (2 * i + 1) / static_cast<double>(kHullDirections), radius = std::sqrt(1 - z * z);
    double sine = 0, cosine = 1;
    SinCos(i * 2.39996322972865332223, sine, cosine);  // the golden angle
    const glm::vec3 direction(static_cast<float>(radius * cosine), static_cast<float>(radius * sine),
                              static_cast<float>(z));
    // A box is farthest at the corner on the direction's side.
    const auto corner = [&](const WeightedBox& box) {
      return glm::mix(box.lower, box.upper, glm::greaterThan(direction, glm::vec3(0)));
    };
    framing.hull.push_back(corner(*std::ranges::max_element(
        parts, {}, [&](const WeightedBox& box) { return glm::dot(corner(box), direction); })));
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
