#include "common/engine/framing_probe.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vector_relational.hpp>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "common/engine/ask_rays.h"
#include "common/engine/framing_bulk.h"
#include "common/engine/renderer.h"
#include "common/math/elementary.h"

namespace quarry {
namespace {

/// Rays in a row of a picture: of one all around, and of one that may become the inside view.
constexpr uint32_t kAround = 8, kAhead = 12;

/// A hit as a probe sees it.
struct ProbedPoint {
  float distance = kInfinity;
  uint32_t triangle = kNoTriangle;
  bool inward = false;  ///< the side that is hit faces the eye by its triangle's winding
  glm::dvec3 place{0};
  glm::dvec4 plane{0};  ///< of the triangle: its unit normal, and its distance from the origin along it
};

/// Looks from places in a scene. Not thread-safe.
class Prober {
 public:
  static Result<std::unique_ptr<Prober>> Create(const Scene& scene) {
    const uint64_t cache = std::max<uint64_t>(64u << 20, scene.catalog().meta.largest_decoded);
    QUARRY_ASSIGN(auto renderer, Renderer::Create(scene, {cache, 1}));
    return std::unique_ptr<Prober>(new Prober(scene, std::move(renderer)));
  }

  /// Points seen from `eye` along `forward`, `degrees` wide and high: `across` a row, as many rows. `sides`:
  /// with the side that is hit, its place and plane.
  Result<std::vector<ProbedPoint>> Look(const glm::dvec3& eye, const glm::dvec3& forward,
                                        const glm::dvec3& up, double degrees, uint32_t across, bool sides) {
    std::vector<RayQuery> rays(size_t{across} * across);
    for (size_t i = 0; i < rays.size(); ++i) rays[i] = {eye, Direction(i, across, forward, up, degrees)};
    QUARRY_ASSIGN(const std::vector<Hit> hits, HitsOf(*renderer_, rays, RayGoal::kNearest));
    std::vector<ProbedPoint> points(hits.size());
    for (size_t i = 0; i < hits.size(); ++i) {
      if (hits[i].triangle == kNoTriangle) continue;
      points[i].distance = hits[i].t;
      points[i].triangle = hits[i].triangle;
      if (sides) {
        QUARRY_TRY(LookAtSide(hits[i], eye, points[i]));
        points[i].place = eye + rays[i].direction * static_cast<double>(hits[i].t);
      }
    }
    return points;
  }

 private:
  Prober(const Scene& scene, std::unique_ptr<Renderer> renderer)
      : scene_(scene), renderer_(std::move(renderer)) {}

  /// The unit vector through a pixel's middle.
  static glm::dvec3 Direction(size_t pixel, uint32_t pixels, const glm::dvec3& forward, const glm::dvec3& up,
                              double degrees) {
    const glm::dvec3 ahead = glm::normalize(forward), right = glm::normalize(glm::cross(ahead, up));
    const auto across = [&](size_t at) {
      return ((static_cast<double>(at) + 0.5) * 2 / pixels - 1) * TanHalfDegrees(degrees);
    };
    return glm::normalize(ahead + across(pixel % pixels) * right -
                          across(pixel / pixels) * glm::cross(right, ahead));
  }

  Status LookAtSide(const Hit& hit, const glm::dvec3& eye, ProbedPoint& point) {
    if (hit.voxel != voxel_) {
      QUARRY_ASSIGN(decoded_, DecodeVoxel(scene_, hit.voxel, decoder_));
      voxel_ = hit.voxel;
    }
    const auto corner = [&](int c) { return glm::dvec3(decoded_.geometry.vertex(hit.local, c)); };
    glm::dvec3 normal = glm::cross(corner(1) - corner(0), corner(2) - corner(0));
    point.inward = glm::dot(normal, eye - corner(0)) > 0;
    normal /= std::max(std::sqrt(glm::dot(normal, normal)), 1e-300);
    // Which way the triangle winds does not matter.
    const bool turn = normal.z != 0 ? normal.z < 0 : normal.y != 0 ? normal.y < 0 : normal.x < 0;
    if (turn) normal = -normal;
    point.plane = {normal, glm::dot(normal, corner(0))};
    return {};
  }

  const Scene& scene_;
  std::unique_ptr<Renderer> renderer_;
  BlockDecoder decoder_;
  DecodedVoxel decoded_;
  uint32_t voxel_ = kNoVoxel;
};

/// Rays in all directions from a place, seen together. Distances are shares of the diagonal; a miss counts
/// as 1.
struct Surroundings {
  double hits = 0;    ///< share of rays
  double backs = 0;   ///< share of hits on the sides that face away by their windings
  double planes = 0;  ///< different planes that are hit
  double detail =
      0;  ///< these of a hit; outside, hits on the plane that is hit most do not count: the ground
  double mean_distance = 0;
};

bool Holds(const Framing& bulk, const glm::dvec3& place, double margin) {
  return glm::all(glm::greaterThan(place, bulk.lower - margin)) &&
         glm::all(glm::lessThan(place, bulk.upper + margin));
}

/// Looks along both ways of each axis from `eye`, or askew from outside toward it: then `bulk` alone counts.
Result<Surroundings> LookAround(Prober& prober, const glm::dvec3& eye, double diagonal, const Framing* bulk) {
  constexpr double kNormalSteps = 16, kPlaceSteps = 100;
  const bool from_outside = bulk != nullptr;
  Surroundings all;
  std::map<std::array<int, 4>, double> planes;
  double rays = 0, hits = 0;
  for (int face = 0; face < 6; ++face) {
    glm::dvec3 forward(0), up(0);
    forward[face / 2] = face % 2 ? 1 : -1;
    up[(face / 2 + 1) % 3] = 1;
    if (from_outside) forward = glm::normalize(forward + 0.4 * up + 0.3 * glm::cross(forward, up));
    const glm::dvec3 from = from_outside ? eye - forward * (2 * diagonal) : eye;
    QUARRY_ASSIGN(const auto points, prober.Look(from, forward, up, from_outside ? 20 : 90, kAround, true));
    for (const ProbedPoint& p : points) {
      const bool hit = p.distance < kInfinity && (!from_outside || Holds(*bulk, p.place, 0.01 * diagonal));
      ++rays;
      hits += hit;
      all.backs += hit && !p.inward;
      all.mean_distance += hit ? static_cast<double>(p.distance) / diagonal : 1;
      if (!hit) continue;
      const auto step = [](double v, double steps) {
        return static_cast<int>(std::clamp(std::floor(v * steps + 0.5), -1e9, 1e9));
      };
      ++planes[{step(p.plane.x, kNormalSteps), step(p.plane.y, kNormalSteps), step(p.plane.z, kNormalSteps),
                step(p.plane.w / diagonal, kPlaceSteps)}];
    }
  }
  all.planes = static_cast<double>(planes.size());
  double ground = 0;
  for (const auto& [plane, count] : planes) ground = std::max(ground, from_outside ? count : 0);
  all.detail = hits > ground ? all.planes / (hits - ground) : 0;
  all.hits = hits / rays;
  all.mean_distance /= rays;
  all.backs = hits > 0 ? all.backs / hits : 0;
  return all;
}

/// Whether the scene is a room that shows little from outside: the outside is plain, nearly all rays from a
/// place in its midst hit something, there is space around it, and it shows about as much as the outside. A
/// scene that its windings call a solid must show more. For an empty box with an open side the windings
/// decide.
Result<bool> IsInterior(Prober& prober, const Core& core, const Framing& framing) {
  constexpr double kNearlyAll = 0.7, kSpace = 0.1, kPlain = 0.4, kAsMuch = 0.6, kAsMuchOfSolid = 1;
  constexpr double kHeights[] = {0.5, 0.25, 0.75};
  constexpr double kBox = 12;  // planes that a box has at most, with its open side
  const auto up = static_cast<int>(framing.up_axis);
  const glm::dvec3 size = core.upper - core.lower, middle = (core.lower + core.upper) * 0.5;
  const double diagonal = glm::length(size);
  QUARRY_ASSIGN(const Surroundings outside, LookAround(prober, middle, diagonal, &framing));
  if (outside.detail > kPlain) return false;
  // The middle of the room may lie in a thing, that of the triangles in another room.
  for (glm::dvec3 place : {middle, core.middle})
    for (const double height : kHeights) {
      place[up] = core.lower[up] + height * size[up];
      QUARRY_ASSIGN(const Surroundings around, LookAround(prober, place, diagonal, nullptr));
      if (around.hits < kNearlyAll || around.mean_distance < kSpace) continue;
      // Backs within walls that show theirs too: the place lies in a solid thing in an open box.
      if (around.backs > kNearlyAll && outside.backs > 0.5) continue;
      // A solid thing shows backs inside and fronts outside. So does a room whose windings are turned.
      const bool solid = around.backs > kNearlyAll && outside.backs < 1 - kNearlyAll;
      if (around.detail > (solid ? kAsMuchOfSolid : kAsMuch) * outside.detail) return true;
      if (outside.planes <= kBox && outside.backs > 0.5 && around.hits < 1) return true;
    }
  return false;
}

/// The camera before a side of the scene through which most rays from the middle leave it: it shows an open
/// box as a stage. None: no side is open.
Result<std::optional<CameraSpec>> BeforeOpenSide(Prober& prober, const Core& core, const Framing& framing) {
  constexpr double kOpen = 0.7;
  constexpr std::pair<double, double> kWays[] = {{0, 1}, {1, 0}, {-1, 0}, {0, -1}};
  const glm::dvec3 middle = (core.lower + core.upper) * 0.5, up = InAxes(0, 0, 1, framing.up_axis);
  for (const auto& [right, back] : kWays) {
    const glm::dvec3 out = InAxes(right, back, 0, framing.up_axis);
    QUARRY_ASSIGN(const auto points, prober.Look(middle, out, up, 40, kAround, false));
    const auto misses =
        std::ranges::count_if(points, [](const ProbedPoint& p) { return !(p.distance < kInfinity); });
    if (static_cast<double>(misses) < kOpen * static_cast<double>(points.size())) continue;
    return FitCamera(framing, out, up, {.margin = 0.02});
  }
  return std::optional<CameraSpec>();
}

/// How much of the scene a picture shows.
struct Prospect {
  double distance = 0;  ///< logarithmic mean, as a share of the diagonal
  double score =
      0;  ///< distance and detail; the sky shows nothing, and a thing close before the eye hides the rest
};

/// The logarithm of the distance of the nearest thing in the picture's middle, as a share of the diagonal.
double ClearView(const std::vector<ProbedPoint>& points, double diagonal) {
  constexpr double kNothing = 0.05;
  double nearest = kInfinity;
  for (uint32_t y = kAhead / 2 - 1; y <= kAhead / 2; ++y)
    for (uint32_t x = kAhead / 4; x < kAhead * 3 / 4; ++x)
      nearest = std::min(nearest, static_cast<double>(points[y * kAhead + x].distance) / diagonal);
  return Log2(nearest < kInfinity ? std::max(nearest, 1e-6) : kNothing);
}

Prospect Judge(const std::vector<ProbedPoint>& points, double diagonal) {
  constexpr double kSky = -5, kClose = 0.03, kDetail = 1, kClear = 1;
  double sum = 0, seen = 0;
  bool close = false;
  std::set<uint32_t> triangles;
  for (const ProbedPoint& p : points) {
    const double distance = static_cast<double>(p.distance) / diagonal;
    const bool hit = p.distance < kInfinity;
    sum += hit ? Log2(std::max(distance, 1e-6)) : kSky;
    seen += hit ? Log2(std::max(distance, 1e-6)) : 0;
    close |= hit && distance < kClose;
    if (hit) triangles.insert(p.triangle);
  }
  const auto count = static_cast<double>(points.size());
  const double detail = Log2(static_cast<double>(triangles.size() + 1) / count);
  return {Exp2(seen / count),
          sum / count + kDetail * detail + kClear * ClearView(points, diagonal) - (close ? 1 : 0)};
}

/// A place and direction inside: before an open side; else of a few places at eye height, each looking eight
/// ways, the one whose picture shows most.
Result<CameraSpec> FindInside(Prober& prober, const Core& core, Framing& framing) {
  constexpr double kShares[] = {0.12, 0.3, 0.5, 0.7, 0.88};
  constexpr int kPlaces = std::size(kShares), kWays = 8;
  constexpr double kFov = 65, kHeight = 0.4;
  if (framing.interior) {
    QUARRY_ASSIGN(const std::optional<CameraSpec> stage, BeforeOpenSide(prober, core, framing));
    if (stage) return *stage;
  }
  const glm::dvec3 size = core.upper - core.lower, up = InAxes(0, 0, 1, framing.up_axis);
  const double diagonal = glm::length(size);
  CameraSpec best{.eye = core.middle, .up = up, .fov_degrees = kFov};
  best.at = best.eye + InAxes(0, -1, 0, framing.up_axis);
  double best_score = -1e300;
  for (int place = 0; place < kPlaces * kPlaces; ++place) {
    const glm::dvec3 share = framing.up_axis == 1
                                 ? glm::dvec3(kShares[place % kPlaces], kHeight, kShares[place / kPlaces])
                                 : glm::dvec3(kShares[place % kPlaces], kShares[place / kPlaces], kHeight);
    const glm::dvec3 eye = core.lower + size * share;
    for (int way = 0; way < kWays; ++way) {
      double sine = 0, cosine = 1;
      SinCos(way * (6.28318530717958647693 / kWays), sine, cosine);
      const glm::dvec3 forward = InAxes(sine, cosine, 0, framing.up_axis);
      QUARRY_ASSIGN(const auto points, prober.Look(eye, forward, up, kFov, kAhead, false));
      const Prospect prospect = Judge(points, diagonal);
      if (prospect.score <= best_score) continue;
      best_score = prospect.score;
      framing.inside_distance = diagonal * prospect.distance;
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
  QUARRY_ASSIGN(const std::vector<WeightedBox> boxes, BoxesOf(scene));
  MeasureBulk(boxes, catalog.meta, framing);
  const Core core = MeasureCore(boxes, framing);
  if (catalog.voxels.empty()) return framing;
  QUARRY_ASSIGN(const std::unique_ptr<Prober> prober, Prober::Create(scene));
  QUARRY_ASSIGN(framing.interior, IsInterior(*prober, core, framing));
  if (framing.interior || find_inside) {
    QUARRY_ASSIGN(framing.inside, FindInside(*prober, core, framing));
  }
  return framing;
}

}  // namespace quarry
