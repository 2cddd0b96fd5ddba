#include "tests/reference/recursive_tracer.h"

#include <algorithm>
#include <cmath>
#include <glm/exponential.hpp>
#include <glm/geometric.hpp>
#include <numbers>
#include <thread>

namespace quarry::test {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kFar = 1e30;

/// Half the angle of a sun's disc.
double HalfAngle(const Light& sun) { return static_cast<double>(sun.angle) * kPi / 360; }

double SolidAngle(const Light& sun) { return 2 * kPi * (1 - std::cos(HalfAngle(sun))); }

/// Suns state their irradiance over pi, of a surface at right angles to each of the disc's rays.
glm::dvec3 DiscOf(const Light& sun) { return glm::dvec3(sun.radiance) * (kPi / SolidAngle(sun)); }

glm::dvec3 FrontOf(const Light& rectangle) {
  return glm::cross(glm::dvec3(rectangle.edges[0]), glm::dvec3(rectangle.edges[1]));
}

double AreaOf(const RecursiveModel::Triangle& t) {
  const glm::dvec3 a(t.corners[0]), b(t.corners[1]), c(t.corners[2]);
  return glm::length(glm::cross(b - a, c - a)) / 2;
}

/// A direction around `axis`, at this cosine to it.
glm::dvec3 Around(const glm::dvec3& axis, double cosine, double turn) {
  const glm::dvec3 other = std::fabs(axis.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const glm::dvec3 across = glm::normalize(glm::cross(axis, other)), along = glm::cross(axis, across);
  const double sine = std::sqrt(std::max(1 - cosine * cosine, 0.0));
  return axis * cosine + (across * std::cos(turn) + along * std::sin(turn)) * sine;
}

/// The tint of light that goes through glass: of the body where it absorbs by length, else of the surface.
glm::dvec3 TintOf(const Material& m) {
  return glm::dvec3(m.transmission_depth > 0 ? m.base_color : m.transmission_color);
}

bool IsPane(const Material& m) { return m.ior <= 1; }

}  // namespace

RecursiveTracer::RecursiveTracer(const RecursiveModel& model, const View& view)
    : model_(model), view_(view), density_of_(model.triangles().size()) {
  double area = 0;
  for (size_t i = 0; i < model.triangles().size(); ++i) {
    const Material& m = model.MaterialOf(i);
    const auto [at, fresh] = shares_of_.try_emplace({m.specular_roughness, m.specular_ior}, shares_.size());
    if (fresh) shares_.emplace_back(m.specular_roughness, m.specular_ior);
    const bool asked = m.emission != glm::vec3(0) && m.geometry_opacity == 1 && m.transmission_weight == 0;
    if (!asked) continue;
    area += AreaOf(model.triangles()[i]);
    shining_.push_back({i, area});
  }
  const size_t kinds = view.lights.size() + (view.sky.shines() ? 1 : 0) + (shining_.empty() ? 0 : 1);
  odds_ = kinds > 0 ? 1 / static_cast<double>(kinds) : 0;
  for (const Shining& shining : shining_) density_of_[shining.triangle] = odds_ / area;
}

std::vector<glm::dvec3> RecursiveTracer::Picture(uint64_t seed, int side) const {
  std::vector<glm::dvec3> picture(size_t{view_.width} * view_.height);
  const auto rows = [&](int first) {
    for (int y = first; y < static_cast<int>(view_.height); y += 2) RowOf(y, seed, side, picture);
  };
  std::thread other([&] { rows(1); });
  rows(0);
  other.join();
  return picture;
}

void RecursiveTracer::RowOf(int y, uint64_t seed, int side, std::vector<glm::dvec3>& picture) const {
  Numbers numbers(seed << 32 | static_cast<uint64_t>(y));
  const CameraSpec& camera = view_.camera;
  const glm::dvec3 ahead = glm::normalize(camera.at - camera.eye);
  const glm::dvec3 right = glm::normalize(glm::cross(ahead, camera.up)), down = glm::cross(ahead, right);
  const double pixel = 2 * std::tan(camera.fov_degrees * kPi / 360) / view_.height;
  for (int x = 0; x < static_cast<int>(view_.width); ++x) {
    glm::dvec3 sum(0);
    for (int cell = 0; cell < side * side; ++cell) {
      const double across = x + (cell % side + numbers.Next()) / side - 0.5 * view_.width;
      const double below =
          y + (static_cast<double>(cell / side) + numbers.Next()) / side - 0.5 * view_.height;
      const glm::dvec3 direction = glm::normalize(ahead + (right * across + down * below) * pixel);
      sum += Radiance({camera.eye, direction, 0, 0}, numbers);
    }
    picture[static_cast<size_t>(y) * view_.width + static_cast<size_t>(x)] = sum / (1.0 * side * side);
  }
}

/// The weight, by the balance heuristic, of a light that a path has met, where a vertex finds it with the
/// density `asked`.
double RecursiveTracer::Met(double density, double asked) const {
  return density > 0 ? density / (density + asked) : 1;
}

glm::dvec3 RecursiveTracer::Radiance(const Way& way, Numbers& numbers) const {
  const auto found = model_.Nearest(way.origin, way.direction, kFar);
  const glm::dvec3 before = Rectangles(way, found ? found->t : kFar);
  if (!found) return before + Behind(way);
  const Meeting at = model_.At(*found, way.direction);
  const Material& m = model_.MaterialOf(found->triangle);
  const double length = glm::length(at.position - way.origin), all = way.since + length;
  const Through through = ThroughOf(m, at);
  const double choice = numbers.Next();
  if (choice < through.hole + through.pane) {
    Way on = way;
    on.origin = Leaving(at, way.direction);
    on.since = all;
    const glm::dvec3 behind = Radiance(on, numbers);
    return before + (choice < through.hole ? behind : behind * through.tint);
  }
  const double cosine = std::max(glm::dot(at.side, at.view), 1e-9);
  const double asked = density_of_[found->triangle] * all * all / cosine;
  const glm::dvec3 light = before + glm::dvec3(m.emission) * Met(way.density, asked);
  if (way.bounce > static_cast<int>(view_.bounces)) return light;
  if (choice < through.hole + through.pane + through.glass) return light + ByGlass(way, at, m, all, numbers);
  return light + Scattered(way, at, m, numbers);
}

/// Holes, and thin panes where they do not mirror, are passed straight on.
RecursiveTracer::Through RecursiveTracer::ThroughOf(const Material& m, const Meeting& at) const {
  const double there = m.geometry_opacity;
  const double glass =
      there * (1 - static_cast<double>(m.base_metalness)) * static_cast<double>(m.transmission_weight);
  if (!IsPane(m)) return {1 - there, 0, glass, glm::dvec3(1)};
  const double mirrored = BoundaryShare(glm::dot(at.side, at.view), m.specular_ior);
  return {1 - there, glass * (1 - mirrored), glass * mirrored, TintOf(m)};
}

/// The start of a ray that leaves a surface, off it on the side to which the ray goes.
glm::dvec3 RecursiveTracer::Leaving(const Meeting& at, const glm::dvec3& direction) const {
  return at.position + at.side * (glm::dot(direction, at.side) > 0 ? model_.offset() : -model_.offset());
}

glm::dvec3 RecursiveTracer::Scattered(const Way& way, const Meeting& at, const Material& m,
                                      Numbers& numbers) const {
  const OpaqueSurface surface(m, shares_[shares_of_.at({m.specular_roughness, m.specular_ior})], at);
  const glm::dvec3 direct = ByLights(at, surface, numbers);
  const OpaqueSurface::Step step = surface.Next(numbers);
  if (step.weight == glm::dvec3(0)) return direct;
  const Way next{Leaving(at, step.direction), step.direction, way.bounce + 1, step.density};
  return direct + step.weight * Radiance(next, numbers);
}

/// Smooth glass mirrors a share and refracts the rest; light has gone through `length` of it where it leaves.
/// A pane is met only where it mirrors.
glm::dvec3 RecursiveTracer::ByGlass(const Way& way, const Meeting& at, const Material& m, double length,
                                    Numbers& numbers) const {
  glm::dvec3 weight(1), direction = MirroredView(at);
  if (!IsPane(m)) {
    if (m.transmission_depth > 0 && !at.entering)
      weight = glm::pow(glm::dvec3(m.transmission_color),
                        glm::dvec3(length / static_cast<double>(m.transmission_depth)));
    const double ior = m.specular_ior, index = at.entering ? ior : 1 / ior;
    const double cosine = std::min(glm::dot(at.normal, at.view), 1.0);
    if (numbers.Next() >= BoundaryShare(cosine, index)) {
      const double sine = std::sqrt(1 - cosine * cosine) / index;
      const glm::dvec3 aside = at.normal * cosine - at.view;  // as long as the sine before the boundary
      direction = glm::normalize(aside / index - at.normal * std::sqrt(std::max(1 - sine * sine, 0.0)));
      weight *= TintOf(m);
    }
  }
  return weight * Radiance({Leaving(at, direction), direction, way.bounce + 1, 0}, numbers);
}

/// The light of one light that a vertex asks for.
glm::dvec3 RecursiveTracer::ByLights(const Meeting& at, const OpaqueSurface& surface,
                                     Numbers& numbers) const {
  if (odds_ == 0) return glm::dvec3(0);
  const Asked asked = Ask(at.position, numbers);
  if (!(asked.density > 0)) return glm::dvec3(0);
  const glm::dvec3 scattered = surface.Scattered(asked.direction);
  if (scattered == glm::dvec3(0)) return glm::dvec3(0);
  return scattered * asked.radiance * Unhidden(at, asked) /
         (asked.density + surface.Density(asked.direction));
}

RecursiveTracer::Asked RecursiveTracer::Ask(const glm::dvec3& position, Numbers& numbers) const {
  const auto kind = static_cast<size_t>(numbers.Next() / odds_);
  if (kind >= view_.lights.size()) {
    if (!view_.sky.shines() || kind > view_.lights.size()) return AskTriangle(position, numbers);
    const double height = 1 - 2 * numbers.Next();
    return {Around({0, 0, 1}, height, 2 * kPi * numbers.Next()), glm::dvec3(view_.sky.radiance), kFar,
            odds_ / (4 * kPi), glm::dvec3(0)};
  }
  const Light& light = view_.lights[kind];
  if (light.kind == LightKind::kSun) {
    const double cosine = 1 - numbers.Next() * (1 - std::cos(HalfAngle(light)));
    return {Around(glm::dvec3(light.vector), cosine, 2 * kPi * numbers.Next()), DiscOf(light), kFar,
            odds_ / SolidAngle(light), glm::dvec3(0)};
  }
  const glm::dvec3 place = glm::dvec3(light.vector) + glm::dvec3(light.edges[0]) * (numbers.Next() - 0.5) +
                           glm::dvec3(light.edges[1]) * (numbers.Next() - 0.5);
  const double distance = glm::length(place - position);
  const glm::dvec3 direction = (place - position) / distance;
  // The front vector is as long as the area.
  const double seen = -glm::dot(direction, FrontOf(light));
  if (!(seen > 0)) return {};
  return {direction, glm::dvec3(light.radiance), distance, odds_ * distance * distance / seen, glm::dvec3(0)};
}

/// A point of the triangles that shine, evenly by area. Source of the point's weights: Turk 1990.
RecursiveTracer::Asked RecursiveTracer::AskTriangle(const glm::dvec3& position, Numbers& numbers) const {
  const double below = numbers.Next() * shining_.back().area_below;
  const auto chosen = std::ranges::lower_bound(shining_, below, {}, &Shining::area_below);
  const RecursiveModel::Triangle& t = model_.triangles()[chosen->triangle];
  const glm::dvec3 a(t.corners[0]), b(t.corners[1]), c(t.corners[2]);
  const double root = std::sqrt(numbers.Next()), along = numbers.Next();
  const glm::dvec3 place = a * (1 - root) + b * (root * (1 - along)) + c * (root * along);
  const double distance = glm::length(place - position);
  const glm::dvec3 direction = (place - position) / distance;
  glm::dvec3 normal = glm::normalize(glm::cross(b - a, c - a));
  if (glm::dot(normal, direction) > 0) normal = -normal;
  const double cosine = -glm::dot(normal, direction);
  if (!(cosine > 1e-9)) return {};
  const Material& m = model_.MaterialOf(chosen->triangle);
  return {direction, glm::dvec3(m.emission), distance,
          density_of_[chosen->triangle] * distance * distance / cosine, normal};
}

/// The share of a light that reaches a vertex: holes and panes let it pass, and panes tint it.
glm::dvec3 RecursiveTracer::Unhidden(const Meeting& at, const Asked& asked) const {
  glm::dvec3 share(1), from = Leaving(at, asked.direction);
  glm::dvec3 direction = asked.direction;
  double left = asked.distance;
  if (left < kFar) {
    const glm::dvec3 to = at.position + direction * left + asked.normal * model_.offset() - from;
    left = glm::length(to);
    direction = to / left;
  }
  while (const auto found = model_.Nearest(from, direction, left)) {
    const Meeting met = model_.At(*found, direction);
    const Through through = ThroughOf(model_.MaterialOf(found->triangle), met);
    share *= glm::dvec3(through.hole) + through.tint * through.pane;
    if (share == glm::dvec3(0)) break;
    const glm::dvec3 next = Leaving(met, direction);
    left -= glm::dot(next - from, direction);
    if (!(left > 0)) break;
    from = next;
  }
  return share;
}

/// The light of the rectangles whose fronts a ray crosses.
glm::dvec3 RecursiveTracer::Rectangles(const Way& way, double length) const {
  glm::dvec3 light(0);
  for (const Light& lamp : view_.lights) {
    if (lamp.kind != LightKind::kRectangle) continue;
    const glm::dvec3 front = FrontOf(lamp), centre(lamp.vector), a(lamp.edges[0]), b(lamp.edges[1]);
    const double seen = -glm::dot(way.direction, front);
    if (!(seen > 0)) continue;
    const double t = glm::dot(way.origin - centre, front) / seen;
    if (!(t > 0) || !(t < length)) continue;
    const glm::dvec3 at = way.origin + way.direction * t - centre;
    // Coordinates along the sides, by the areas that the other side spans.
    const double all = glm::dot(front, front);
    if (std::fabs(glm::dot(glm::cross(at, b), front)) > all / 2) continue;
    if (std::fabs(glm::dot(glm::cross(a, at), front)) > all / 2) continue;
    const double distance = way.since + t;
    light += glm::dvec3(lamp.radiance) * Met(way.density, odds_ * distance * distance / seen);
  }
  return light;
}

/// The discs of suns, and the sky, which the eye does not see.
glm::dvec3 RecursiveTracer::Behind(const Way& way) const {
  glm::dvec3 light(0);
  for (const Light& sun : view_.lights) {
    if (sun.kind != LightKind::kSun || sun.angle == 0) continue;
    if (glm::dot(way.direction, glm::normalize(glm::dvec3(sun.vector))) < std::cos(HalfAngle(sun))) continue;
    light += DiscOf(sun) * Met(way.density, odds_ / SolidAngle(sun));
  }
  if (way.bounce > 0) light += glm::dvec3(view_.sky.radiance) * Met(way.density, odds_ / (4 * kPi));
  return light;
}

}  // namespace quarry::test
