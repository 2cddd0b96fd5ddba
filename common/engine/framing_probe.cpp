#include "common/engine/framing_probe.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <vector>

#include "common/engine/renderer.h"
#include "common/math/elementary.h"
#include "common/voxel/block_decoder.h"

namespace quarry {
namespace {

/// Triangles that may lie outside the bulk at either end of an axis, as a share of all.
constexpr double kStrays = 0.005;
/// The bulk is the box of all triangles unless that is so many times as long, diagonal by diagonal.
constexpr double kFarLarger = 2;
/// Stores of at most so many voxels are measured by their triangles, others by their voxels' cells.
constexpr size_t kFewVoxels = 16;
/// Directions in which the hull has points.
constexpr int kHullDirections = 256;

/// A box that holds `weight` triangles.
struct WeightedBox {
  glm::vec3 lower, upper;
  double weight;
};

/// The cells of the top-level tree's leaves that have voxels, cut down to these.
std::vector<WeightedBox> CellsOf(const Catalog& catalog) {
  struct Open {
    uint32_t node;
    glm::vec3 lower, upper;
  };
  std::vector<WeightedBox> boxes;
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
      boxes.push_back({glm::max(cell.lower, voxel.bounds_lower), glm::min(cell.upper, voxel.bounds_upper),
                       static_cast<double>(voxel.triangles)});
    }
  }
  return boxes;
}

/// A decoded hot block.
struct DecodedVoxel {
  Bytes memory;
  VoxelGeometry geometry;
};

Result<DecodedVoxel> Decode(const Scene& scene, uint32_t voxel, BlockDecoder& decoder) {
  const Catalog& catalog = scene.catalog();
  QUARRY_ASSIGN(const Bytes stored, scene.store().ReadBlock(BlockKey::Hot(voxel)));
  DecodedVoxel decoded;
  decoded.memory.resize(catalog.block(BlockKey::Hot(voxel)).decoded);
  QUARRY_ASSIGN(decoded.geometry, DecodeHot(decoder, catalog, voxel, stored, decoded.memory));
  return decoded;
}

Result<std::vector<WeightedBox>> TrianglesOf(const Scene& scene) {
  std::vector<WeightedBox> boxes;
  BlockDecoder decoder;
  for (uint32_t v = 0; v < scene.catalog().voxels.size(); ++v) {
    QUARRY_ASSIGN(const DecodedVoxel voxel, Decode(scene, v, decoder));
    for (uint32_t t = 0; t < scene.catalog().voxels[v].triangles; ++t) {
      const glm::vec3 a = voxel.geometry.vertex(t, 0), b = voxel.geometry.vertex(t, 1),
                      c = voxel.geometry.vertex(t, 2);
      boxes.push_back({glm::min(a, glm::min(b, c)), glm::max(a, glm::max(b, c)), 1});
    }
  }
  return boxes;
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

/// Sets the bulk and the hull.
void MeasureBulk(const std::vector<WeightedBox>& boxes, const SceneMeta& meta, Framing& framing) {
  framing.lower = glm::dvec3(meta.bounds_lower);
  framing.upper = glm::dvec3(meta.bounds_upper);
  glm::dvec3 lower, upper;
  for (int a = 0; a < 3; ++a) {
    lower[a] = Quantile(boxes, a, kStrays);
    upper[a] = Quantile(boxes, a, 1 - kStrays);
  }
  if (glm::length(framing.upper - framing.lower) > kFarLarger * glm::length(upper - lower)) {
    framing.lower = lower;
    framing.upper = upper;
  }
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

/// A hit as a probe sees it.
struct ProbedPoint {
  float distance = kInfinity;
  bool inward = false;  ///< the side that is hit faces the eye by its triangle's winding
};

/// Traces small pictures from places in a scene. Not thread-safe.
class Prober {
 public:
  static constexpr uint32_t kSide = 8;  ///< pixels

  static Result<std::unique_ptr<Prober>> Create(const Scene& scene) {
    const uint64_t cache = std::max<uint64_t>(64u << 20, scene.catalog().meta.largest_decoded);
    QUARRY_ASSIGN(auto renderer, Renderer::Create(scene, {cache, 1}));
    return std::unique_ptr<Prober>(new Prober(scene, std::move(renderer)));
  }

  /// kSide x kSide points seen from `eye` along `forward`, `degrees` wide and high.
  Result<std::vector<ProbedPoint>> Look(const glm::dvec3& eye, const glm::dvec3& forward,
                                        const glm::dvec3& up, double degrees, bool sides) {
    View view;
    view.width = view.height = kSide;
    view.crop = {0, 0, kSide, kSide};
    view.camera = {.eye = eye, .at = eye + forward, .up = up, .fov_degrees = degrees};
    const Tile tile{view.crop, 1, true};
    std::vector<Hit> hits;
    QUARRY_TRY(renderer_->Render(
        view, std::span(&tile, 1),
        [&](size_t, RenderedTile result, Renderer::Progress) { hits = std::move(result.hits); }));
    std::vector<ProbedPoint> points(hits.size());
    for (size_t i = 0; i < hits.size(); ++i) {
      if (hits[i].triangle == kNoTriangle) continue;
      points[i].distance = hits[i].t;
      if (sides) {
        QUARRY_ASSIGN(points[i].inward, FacesEye(hits[i], eye));
      }
    }
    return points;
  }

 private:
  Prober(const Scene& scene, std::unique_ptr<Renderer> renderer)
      : scene_(scene), renderer_(std::move(renderer)) {}

  Result<bool> FacesEye(const Hit& hit, const glm::dvec3& eye) {
    if (hit.voxel != voxel_) {
      QUARRY_ASSIGN(decoded_, Decode(scene_, hit.voxel, decoder_));
      voxel_ = hit.voxel;
    }
    const auto corner = [&](int c) { return glm::dvec3(decoded_.geometry.vertex(hit.local, c)); };
    return glm::dot(glm::cross(corner(1) - corner(0), corner(2) - corner(0)), eye - corner(0)) > 0;
  }

  const Scene& scene_;
  std::unique_ptr<Renderer> renderer_;
  BlockDecoder decoder_;
  DecodedVoxel decoded_;
  uint32_t voxel_ = kNoVoxel;
};

/// Whether nearly all rays from the middle hit sides that face inwards.
Result<bool> IsInterior(Prober& prober, const Framing& framing) {
  constexpr double kNearlyAll = 0.75;
  const glm::dvec3 middle = (framing.lower + framing.upper) * 0.5;
  size_t rays = 0, inward = 0;
  for (int face = 0; face < 6; ++face) {
    glm::dvec3 forward(0), up(0);
    forward[face / 2] = face % 2 ? 1 : -1;
    up[(face / 2 + 1) % 3] = 1;
    QUARRY_ASSIGN(const auto points, prober.Look(middle, forward, up, 90, true));
    rays += points.size();
    inward +=
        static_cast<size_t>(std::ranges::count_if(points, [](const ProbedPoint& p) { return p.inward; }));
  }
  return static_cast<double>(inward) >= kNearlyAll * static_cast<double>(rays);
}

/// A place and direction inside: of a few places at eye height, each looking eight ways, the one with the
/// farthest view in the logarithmic mean, and nothing close before it.
Result<CameraSpec> FindInside(Prober& prober, const Framing& framing) {
  constexpr int kPlaces = 3, kWays = 8;
  constexpr double kFov = 70;
  const glm::dvec3 size = framing.upper - framing.lower;
  const double diagonal = glm::length(size);
  const glm::dvec3 up = InAxes(0, 0, 1, framing.up_axis);
  CameraSpec best{.eye = (framing.lower + framing.upper) * 0.5, .up = up, .fov_degrees = kFov};
  best.at = best.eye + InAxes(0, -1, 0, framing.up_axis);
  double best_score = -1e300;
  for (int place = 0; place < kPlaces * kPlaces; ++place) {
    const double share[3] = {(place % kPlaces + 1.0) / (kPlaces + 1), (place / kPlaces + 1.0) / (kPlaces + 1),
                             0.4};
    glm::dvec3 eye;
    for (int a = 0; a < 3; ++a) {
      const bool is_up = a == static_cast<int>(framing.up_axis);
      eye[a] = framing.lower[a] + size[a] * (is_up ? share[2] : share[a == 0 ? 0 : 1]);
    }
    for (int way = 0; way < kWays; ++way) {
      double sine = 0, cosine = 1;
      SinCos(way * (6.28318530717958647693 / kWays), sine, cosine);
      const glm::dvec3 forward = InAxes(sine, cosine, 0, framing.up_axis);
      QUARRY_ASSIGN(const auto points, prober.Look(eye, forward, up, kFov, false));
      double sum = 0, nearest = 1e300;
      size_t seen = 0;
      for (const ProbedPoint& p : points) {
        if (!(p.distance < kInfinity)) continue;
        const double distance = static_cast<double>(p.distance);
        sum += Log2(std::max(distance / diagonal, 1e-6));
        nearest = std::min(nearest, distance);
        ++seen;
      }
      if (seen == 0) continue;
      // A picture of the sky shows nothing of the scene; a wall at arm's length hides it.
      const double all = static_cast<double>(points.size()), missing = all - static_cast<double>(seen);
      const double score = (sum - missing) / all - (nearest < 0.02 * diagonal ? 2 : 0);
      if (score <= best_score) continue;
      best_score = score;
      best.eye = eye;
      best.at = eye + forward * diagonal;
    }
  }
  return best;
}

}  // namespace

Result<Framing> ProbeFraming(const Scene& scene, uint32_t up_axis, bool find_inside) {
  const Catalog& catalog = scene.catalog();
  Framing framing;
  framing.up_axis = up_axis != 0 ? up_axis : catalog.meta.up_axis;
  std::vector<WeightedBox> boxes;
  if (catalog.voxels.size() <= kFewVoxels) {
    QUARRY_ASSIGN(boxes, TrianglesOf(scene));
  } else
    boxes = CellsOf(catalog);
  MeasureBulk(boxes, catalog.meta, framing);
  if (catalog.voxels.empty()) return framing;
  QUARRY_ASSIGN(const std::unique_ptr<Prober> prober, Prober::Create(scene));
  QUARRY_ASSIGN(framing.interior, IsInterior(*prober, framing));
  if (framing.interior || find_inside) {
    QUARRY_ASSIGN(framing.inside, FindInside(*prober, framing));
  }
  return framing;
}

}  // namespace quarry
