#include "common/engine/integrators/path/path_lights.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>

#include "common/engine/integrators/scatter.h"
#include "common/math/elementary.h"
#include "common/math/sampling.h"
#include "common/scene/sky/atmosphere.h"

namespace quarry {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr auto kPiFloat = static_cast<float>(kPi);

/// Numbers of a choice: as many as SobolSample() gives, so that shares of them are exact.
constexpr uint32_t kNumbers = 1u << 24;

float ChanceOf(uint32_t begin, uint32_t end) {
  return static_cast<float>(end - begin) / static_cast<float>(kNumbers);
}

/// The entry whose numbers a choice is among.
size_t Chosen(const std::vector<uint32_t>& below, float choice) {
  const auto number = static_cast<uint32_t>(choice * static_cast<float>(kNumbers));
  const auto at = static_cast<size_t>(std::ranges::upper_bound(below, number) - below.begin());
  return std::min(at, below.size() - 1);
}

/// Appends the end of an entry's numbers, of which `below` is the share up to that end.
void EndNumbers(double below, bool last, std::vector<uint32_t>& ends) {
  ends.push_back(last ? kNumbers : static_cast<uint32_t>(below * static_cast<double>(kNumbers)));
}

double MeanOf(const glm::vec3& v) {
  return (static_cast<double>(v.x) + static_cast<double>(v.y) + static_cast<double>(v.z)) / 3;
}

/// Whether one face of the section's box, or one of its planes, cuts all of these points off.
bool IsCutOff(const SectionCut& section, std::span<const glm::vec3> points) {
  const auto all = [&](auto&& beyond) { return std::ranges::all_of(points, beyond); };
  for (int axis = 0; section.has_box && axis < 3; ++axis)
    if (all([&](const glm::vec3& p) { return static_cast<double>(p[axis]) < section.lower[axis]; }) ||
        all([&](const glm::vec3& p) { return static_cast<double>(p[axis]) > section.upper[axis]; }))
      return true;
  return std::ranges::any_of(section.planes, [&](const SectionPlane& plane) {
    return all([&](const glm::vec3& p) { return glm::dot(glm::dvec3(p) - plane.point, plane.normal) > 0; });
  });
}

/// Weights of the second and third corner of a triangle, uniform over it. Source: Turk 1990.
glm::vec2 InTriangle(const glm::vec2& u) {
  const float root = std::sqrt(u.x);
  return {root * (1 - u.y), root * u.y};
}

/// A direction from the cap of the sphere of directions around `middle`, uniform over it. `height`: 1 - the
/// cosine of its edge. The height of a direction falls with the square of the radius of a point on a disk.
glm::vec3 InCap(const glm::vec3& middle, float height, const glm::vec2& u) {
  const glm::vec2 disk = ConcentricDisk(u);
  const float r2 = std::min(glm::dot(disk, disk), 1.0f), low = height * r2;
  const float side = std::sqrt(std::max(low * (2 - low), 0.0f) / std::max(r2, 1e-18f));
  glm::vec3 across, along;
  Tangents(middle, across, along);
  return Unit(across * (disk.x * side) + along * (disk.y * side) + middle * (1 - low));
}

/// The directions in which a light's sphere is seen.
struct SphereCap {
  glm::vec3 middle{0};
  float distance = 0;  ///< of its centre
  float height = 0;    ///< 1 - the cosine of its edge; 0: it is not seen
  float density() const { return 1 / (2 * kPiFloat * height); }
};
SphereCap CapOf(const Light& light, const glm::vec3& position) {
  const glm::vec3 to = light.vector - position;
  const float distance2 = glm::dot(to, to), sine2 = light.radius * light.radius / distance2;
  if (!(sine2 < 1)) return {};
  const float distance = std::sqrt(distance2);
  return {to / distance, distance, sine2 / (1 + std::sqrt(1 - sine2))};
}

/// Where a ray enters a light's sphere; it may be behind the origin. None: it passes by.
std::optional<float> DistanceTo(const Light& light, const glm::vec3& origin, const glm::vec3& direction) {
  const glm::vec3 to = light.vector - origin;
  const float along = glm::dot(to, direction);
  const glm::vec3 aside = to - direction * along;
  const float half2 = light.radius * light.radius - glm::dot(aside, aside);
  if (!(half2 > 0)) return std::nullopt;
  return along - std::sqrt(half2);
}

/// The power that a light sends into a sphere of radius `radius` around the scene; a unit is 4 pi^2.
double PowerOf(const Light& light, double area, double radius) {
  switch (light.kind) {
    case LightKind::kSun:
      return MeanOf(light.radiance) * radius * radius / 4;
    case LightKind::kRectangle:
      return MeanOf(light.radiance) * area / (4 * kPi);
    case LightKind::kPoint:
      break;
  }
  return MeanOf(light.radiance);
}

}  // namespace

uint32_t UpAxisOf(const View& view, const SceneMeta& scene) {
  return view.up_axis != 0 ? view.up_axis : scene.up_axis;
}

float SphereRadius(const Light& light, const SceneMeta& scene) {
  constexpr float kLeast = 1e-6f;
  const float size = Largest(scene.bounds_upper - scene.bounds_lower);
  return light.kind == LightKind::kPoint && light.radius > kLeast * size ? light.radius : 0.0f;
}

PathLights::Entry PathLights::EntryOf(const Light& light) {
  Entry entry;
  entry.light = &light;
  if (light.kind == LightKind::kSun && light.angle > 0) {
    double sine = 0, cosine = 1;
    SinCos(static_cast<double>(light.angle) * kPi / 720, sine, cosine);
    const double cap = 2 * sine * sine, solid = 2 * kPi * cap;  // 1 - cos(a) is 2 sin(a / 2)^2
    entry.cap = static_cast<float>(cap);
    entry.sine2 = static_cast<float>(4 * sine * sine * cosine * cosine);
    entry.disc_density = static_cast<float>(1 / solid);
    entry.disc = light.radiance * static_cast<float>(kPi / solid);
  }
  if (light.radius > 0) entry.sphere = light.radiance / (light.radius * light.radius);
  if (light.kind == LightKind::kRectangle) {
    const glm::dvec3 cross = glm::cross(glm::dvec3(light.edges[0]), glm::dvec3(light.edges[1]));
    const double area = std::sqrt(glm::dot(cross, cross));
    entry.area = static_cast<float>(area);
    entry.front = glm::vec3(cross / area);
  }
  return entry;
}

PathLights::PathLights(const View& view, const Catalog& scene, LightWays ways,
                       const EnvironmentPages& environment, EmitterChoice choice)
    : lights_(LightsInAir(view)), section_(view.section), ways_(ways) {
  const SceneMeta& meta = scene.meta;
  const glm::dvec3 size = glm::dvec3(meta.bounds_upper) - glm::dvec3(meta.bounds_lower);
  const double radius = std::max(std::sqrt(glm::dot(size, size)) / 2, 1e-30);
  std::vector<double> powers;
  const auto add = [&](const Entry& entry, double power) {
    if (!(power > 0)) return;
    entries_.push_back(entry);
    powers.push_back(power);
  };
  for (Light& light : lights_) light.radius = SphereRadius(light, meta);
  for (const Light& light : lights_) {
    const Entry entry = EntryOf(light);
    add(entry, PowerOf(light, static_cast<double>(entry.area), radius));
    can_be_met_ |= entry.disc_density > 0 || entry.area > 0 || entry.sphere != glm::vec3(0);
  }
  if (view.sky.shines()) {
    const auto sun = std::ranges::find(view.lights, LightKind::kSun, &Light::kind);
    const glm::vec3 up = UpAxisOf(view, meta) == 1 ? glm::vec3(0, 1, 0) : glm::vec3(0, 0, 1);
    const Light above = sun == view.lights.end() ? Light{.vector = up} : *sun;
    sky_.emplace(view.sky, above.vector, up, above.radiance);
    add({}, MeanOf(sky_->mean()) * radius * radius);
    can_be_met_ = true;
  }
  if (view.environment.shines()) {
    environment_.emplace(view.environment, environment, UpAxisOf(view, meta));
    add({}, std::max(MeanOf(environment_->mean()), 1e-30) * radius * radius);
    can_be_met_ = true;
  }
  Entry emitters;
  emitters.emitters = true;
  add(emitters, TakeEmitters(view, scene, choice));
  ShareChances(powers);
}

/// Each light is chosen by its power and evenly, by halves, so that a weak lamp near by is asked beside the
/// sun.
void PathLights::ShareChances(const std::vector<double>& powers) {
  double all = 0, below = 0;
  for (const double power : powers) all += power;
  for (size_t i = 0; i < entries_.size(); ++i) {
    const uint32_t begin = i == 0 ? 0 : chosen_below_.back();
    below += 0.5 * powers[i] / all + 0.5 / static_cast<double>(entries_.size());
    EndNumbers(below, i + 1 == entries_.size(), chosen_below_);
    entries_[i].chance = ChanceOf(begin, chosen_below_.back());
    if (environment_ && !entries_[i].light && !entries_[i].emitters) environment_chance_ = entries_[i].chance;
    if (entries_[i].emitters) emitters_chance_ = entries_[i].chance;
  }
}

/// Takes up the emitters that the view shows as they are. Returns their power.
double PathLights::TakeEmitters(const View& view, const Catalog& scene, EmitterChoice choice) {
  const PartSelection* const selection = view.parts.selection.get();
  std::vector<EmitterTree::Emitter> boxes;
  boxes.reserve(scene.emitters.size());
  shining_.reserve(scene.emitters.size());
  double all = 0;
  for (const Emitter& emitter : scene.emitters) {
    if (selection && (HasPart(selection->hidden, emitter.part) || selection->ColorOf(emitter.part))) continue;
    if (IsCutOff(section_, emitter.corners)) continue;
    const double area = AreaOf(emitter);
    Shining shining;
    shining.triangle = emitter.triangle;
    shining.corner = emitter.corners[0];
    for (int i = 0; i < 2; ++i) shining.sides[i] = emitter.corners[i + 1] - emitter.corners[0];
    const glm::dvec3 a(emitter.corners[0]), b(emitter.corners[1]), c(emitter.corners[2]);
    shining.normal = glm::vec3(glm::cross(b - a, c - a) / (2 * area));
    shining.radiance = emitter.radiance;
    if (EmissionMapOf(scene.materials[emitter.material])) {
      shining.mapped = static_cast<uint32_t>(mapped_.size());
      mapped_.push_back({emitter.material, {emitter.uvs[0], emitter.uvs[1], emitter.uvs[2]}});
    }
    shining.area = static_cast<float>(area);
    shining_.push_back(shining);
    const auto& corners = emitter.corners;
    boxes.push_back({glm::min(glm::min(corners[0], corners[1]), corners[2]),
                     glm::max(glm::max(corners[0], corners[1]), corners[2]), shining.normal,
                     MeanOf(shining.radiance) * area / (2 * kPi)});
    all += boxes.back().power;
  }
  mapped_.shrink_to_fit();
  tree_ = EmitterTree(boxes, choice == EmitterChoice::kByPower);
  return all;
}

float PathLights::AskedShare(float asked, float met) const {
  if (ways_ != LightWays::kBoth) return ways_ == LightWays::kAsked ? 1.0f : 0.0f;
  const float a = asked * asked, b = met * met;
  return a / (a + b);
}

float PathLights::MetShare(float met, float asked) const {
  if (!(met > 0) || !(asked > 0)) return 1;
  return 1 - AskedShare(asked, met);
}

PathLights::Sample PathLights::Toward(const Vertex& vertex, const glm::vec2& choice,
                                      const glm::vec2& u) const {
  const size_t chosen = Chosen(chosen_below_, choice.x);
  const Entry& entry = entries_[chosen];
  const glm::vec3& position = vertex.position;
  if (entry.emitters) {
    // One number has too few bits for the tree. The number that chose the entry has bits left, which are
    // added.
    const uint32_t begin = chosen == 0 ? 0 : chosen_below_[chosen - 1];
    const double left_over =
        (static_cast<double>(choice.x) * kNumbers - begin) / (chosen_below_[chosen] - begin);
    return TowardEmitter(vertex,
                         static_cast<double>(choice.y) + std::clamp(left_over, 0.0, 0.999999) / kNumbers, u);
  }
  if (!entry.light && environment_) {
    const EnvironmentLight::Sample in_sky = environment_->Toward(choice.y, u);
    const float density = in_sky.density * entry.chance;
    return {in_sky.direction, kInfinity, glm::vec3(1 / density), density, glm::vec3(0), in_sky.texel};
  }
  if (!entry.light) {
    const glm::vec3 direction = sky_->Direction(u);
    const float density = sky_->Density(direction) * entry.chance;
    if (!(density > 0)) return {};
    return {direction, kInfinity, sky_->Radiance(direction) / density, density};
  }
  if (entry.area > 0) return TowardRectangle(entry, position, u);
  if (entry.disc_density > 0) return TowardDisc(entry, u);
  if (entry.sphere != glm::vec3(0)) return TowardSphere(entry, position, u);
  const LightSample seen = SampleLight(*entry.light, position);
  return {seen.direction, seen.distance, seen.radiance * (kPiFloat / entry.chance), 0};
}

PathLights::Sample PathLights::TowardRectangle(const Entry& entry, const glm::vec3& position,
                                               const glm::vec2& u) {
  const Light& light = *entry.light;
  const glm::vec3 to =
      light.vector + light.edges[0] * (u.x - 0.5f) + light.edges[1] * (u.y - 0.5f) - position;
  const float distance2 = std::max(glm::dot(to, to), 1e-20f), distance = std::sqrt(distance2);
  const glm::vec3 direction = to / distance;
  const float cosine = -glm::dot(direction, entry.front);
  if (!(cosine > 0)) return {};
  const float density = entry.chance * distance2 / (entry.area * cosine);
  return {direction, distance, light.radiance / density, density};
}

PathLights::Sample PathLights::TowardDisc(const Entry& entry, const glm::vec2& u) {
  const glm::vec3 direction = InCap(entry.light->vector, entry.cap, u);
  const float density = entry.disc_density * entry.chance;
  return {direction, kInfinity, entry.disc / density, density};
}

/// Uniform over the directions toward the sphere. Nothing shines where the position is inside.
PathLights::Sample PathLights::TowardSphere(const Entry& entry, const glm::vec3& position,
                                            const glm::vec2& u) {
  const SphereCap cap = CapOf(*entry.light, position);
  if (!(cap.height > 0)) return {};
  const glm::vec3 direction = InCap(cap.middle, cap.height, u);
  const float density = entry.chance * cap.density();
  const glm::vec3 light = entry.sphere * (ConeShare(*entry.light, direction) / density);
  return {direction, DistanceTo(*entry.light, position, direction).value_or(cap.distance), light, density};
}

PathLights::MapPlace PathLights::PlaceInMap(uint32_t mapped, const glm::vec2& u) const {
  const Mapped& map = mapped_[mapped];
  const glm::vec2 b = InTriangle(u);
  return {map.material, map.uvs[0] * (1 - b.x - b.y) + map.uvs[1] * b.x + map.uvs[2] * b.y};
}

PathLights::Sample PathLights::TowardEmitter(const Vertex& vertex, double choice, const glm::vec2& u) const {
  const EmitterTree::Choice chosen = tree_.Choose(vertex.position, vertex.side, choice);
  if (!(chosen.chance > 0)) return {};
  const Shining& shining = shining_[chosen.emitter];
  const glm::vec2 b = InTriangle(u);
  const glm::vec3 at = shining.corner + shining.sides[0] * b.x + shining.sides[1] * b.y,
                  to = at - vertex.position;
  if (IsCutOff(section_, std::span(&at, 1))) return {};
  const float distance2 = std::max(glm::dot(to, to), 1e-20f), distance = std::sqrt(distance2);
  const glm::vec3 direction = to / distance;
  const float turn = glm::dot(direction, shining.normal), cosine = std::fabs(turn);
  if (!(cosine > 1e-6f)) return {};
  const float density = emitters_chance_ * chosen.chance * distance2 / (shining.area * cosine);
  const glm::vec3 radiance = shining.mapped == kNoIndex ? shining.radiance : glm::vec3(1);
  return {direction,
          distance,
          radiance / density,
          density,
          turn < 0 ? shining.normal : -shining.normal,
          EnvironmentLight::kNoTexel,
          shining.mapped};
}

float PathLights::EmitterDensity(uint32_t triangle, const Vertex& vertex, float distance,
                                 float cosine) const {
  const auto at = std::ranges::lower_bound(shining_, triangle, {}, &Shining::triangle);
  if (at == shining_.end() || at->triangle != triangle) return 0;
  const auto emitter = static_cast<uint32_t>(at - shining_.begin());
  const float chance = emitters_chance_ * tree_.ChanceOf(emitter, vertex.position, vertex.side);
  return chance * distance * distance / (at->area * std::max(cosine, 1e-6f));
}

glm::vec3 PathLights::OnTheWay(const glm::vec3& origin, const glm::vec3& direction, float begin, float end,
                               float density) const {
  glm::vec3 all(0);
  for (const Entry& entry : entries_) {
    if (entry.area > 0) all += OfRectangle(entry, origin, direction, begin, end, density);
    if (entry.sphere != glm::vec3(0)) all += OfSphere(entry, origin, direction, begin, end, density);
  }
  return all;
}

glm::vec3 PathLights::OfRectangle(const Entry& entry, const glm::vec3& origin, const glm::vec3& direction,
                                  float begin, float end, float density) const {
  const Light& light = *entry.light;
  const float cosine = -glm::dot(direction, entry.front);
  if (!(cosine > 0)) return glm::vec3(0);
  const float t = glm::dot(origin - light.vector, entry.front) / cosine;
  if (!(t > begin) || !(t < end)) return glm::vec3(0);
  const glm::vec3 at = origin + direction * t - light.vector;
  const auto within = [&](const glm::vec3& edge, const glm::vec3& across) {
    const glm::vec3 dual = glm::cross(across, entry.front);
    return std::fabs(glm::dot(at, dual)) <= 0.5f * std::fabs(glm::dot(edge, dual));
  };
  if (!within(light.edges[0], light.edges[1]) || !within(light.edges[1], light.edges[0])) return glm::vec3(0);
  return light.radiance * MetShare(density, entry.chance * t * t / (entry.area * cosine));
}

glm::vec3 PathLights::OfSphere(const Entry& entry, const glm::vec3& origin, const glm::vec3& direction,
                               float begin, float end, float density) const {
  const std::optional<float> t = DistanceTo(*entry.light, origin, direction);
  if (!t || !(*t > begin) || !(*t < end)) return glm::vec3(0);
  const glm::vec3 light = entry.sphere * ConeShare(*entry.light, direction);
  if (!(density > 0)) return light;  // the origin may have been moved along the ray, into the sphere
  const SphereCap cap = CapOf(*entry.light, origin);
  return cap.height > 0 ? light * MetShare(density, entry.chance * cap.density()) : glm::vec3(0);
}

glm::vec3 PathLights::Discs(const glm::vec3& direction, float density) const {
  glm::vec3 all(0);
  for (const Entry& entry : entries_) {
    if (!(entry.disc_density > 0) || !(glm::dot(direction, entry.light->vector) > 0)) continue;
    const glm::vec3 aside = glm::cross(direction, entry.light->vector);
    if (glm::dot(aside, aside) > entry.sine2) continue;
    all += entry.disc * MetShare(density, entry.disc_density * entry.chance);
  }
  return all;
}

glm::vec3 PathLights::OfSky(const glm::vec3& direction, float density) const {
  glm::vec3 all(0);
  if (!sky_) return all;
  for (const Entry& entry : entries_)
    if (!entry.light && !entry.emitters)
      all += sky_->Radiance(direction) * MetShare(density, sky_->Density(direction) * entry.chance);
  return all;
}

}  // namespace quarry
