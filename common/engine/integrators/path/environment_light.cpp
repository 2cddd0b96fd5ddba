#include "common/engine/integrators/path/environment_light.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/math/elementary.h"

namespace quarry {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

/// Turns a vector from the axes of the image, where z is up, to those of the scene; and back.
glm::vec3 ToScene(double x, double y, double z, uint32_t up_axis) {
  const glm::dvec3 v = up_axis == 1 ? glm::dvec3(x, z, -y) : glm::dvec3(x, y, z);
  return glm::vec3(v);
}
glm::dvec3 ToImage(const glm::vec3& v, uint32_t up_axis) {
  return up_axis == 1 ? glm::dvec3(v.x, -v.z, v.y) : glm::dvec3(v);
}

uint32_t Wrapped(double at, uint32_t size) {
  const double around = at - std::floor(at / size) * size;
  return std::min(static_cast<uint32_t>(around), size - 1);
}

}  // namespace

EnvironmentLight::EnvironmentLight(const ViewEnvironment& environment, const EnvironmentPages& pages,
                                   uint32_t up_axis)
    : table_(*pages.catalog->sky),
      pyramid_(*pages.catalog, 0),
      number_(pages.number),
      up_axis_(up_axis),
      turn_(environment.turn / 360),
      strength_(environment.strength),
      scale_(std::ldexp(environment.strength, table_.facts().exponent)) {}

/// Uniform over the solid angle of the place that is chosen.
EnvironmentLight::Sample EnvironmentLight::Toward(float choice, const glm::vec2& u) const {
  const SkyCells& cells = table_.cells();
  const SkyTable::Choice chosen = table_.Chosen(choice);
  const SkyCells::Rect& r = chosen.rect;
  const double x = r.x0 + static_cast<double>(u.x) * (r.x1 - r.x0);
  const double top = cells.CosineAt(r.y0),
               height = top + static_cast<double>(u.y) * (cells.CosineAt(r.y1) - top);
  double sine = 0, cosine = 1;
  SinCos(kTurn * (0.5 - x / cells.width() + turn_), sine, cosine);
  const double side = std::sqrt(std::max(1 - height * height, 0.0));
  uint32_t row = r.y0;
  while (row + 1 < r.y1 && height < cells.CosineAt(row + 1)) ++row;
  const uint32_t column = std::min(static_cast<uint32_t>(x), r.x1 - 1);
  return {ToScene(side * cosine, side * sine, height, up_axis_),
          static_cast<float>(static_cast<double>(chosen.chance) / cells.SolidAngle(r)),
          row * cells.width() + column};
}

float EnvironmentLight::Density(uint32_t texel) const {
  const SkyCells& cells = table_.cells();
  const SkyTable::Choice place = table_.Around(texel % cells.width(), texel / cells.width());
  return static_cast<float>(static_cast<double>(place.chance) / cells.SolidAngle(place.rect));
}

uint32_t EnvironmentLight::TexelAt(const glm::vec3& direction, const glm::vec2& u) const {
  const SkyCells& cells = table_.cells();
  const uint32_t width = cells.width(), height = cells.height();
  const glm::dvec3 d = ToImage(direction, up_axis_);
  const double from_zenith = ArcTan2(std::sqrt(d.x * d.x + d.y * d.y), d.z) / std::numbers::pi;
  const double around = 0.5 - ArcTan2(d.y, d.x) / kTurn + turn_;
  const uint32_t x = Wrapped(around * width + static_cast<double>(u.x) - 0.5, width);
  const double down = from_zenith * height + static_cast<double>(u.y) - 0.5;
  const auto y = static_cast<uint32_t>(std::clamp(down, 0.0, static_cast<double>(height - 1)));
  return y * width + x;
}

EnvironmentLight::Place EnvironmentLight::PlaceOf(uint32_t texel) const {
  const uint32_t width = table_.cells().width();
  const TexelPlace place = quarry::PlaceOf(pyramid_, 0, texel % width, texel / width);
  return {BlockKey::Sky(number_, place.page.index()), place.index};
}

glm::vec3 EnvironmentLight::RadianceAt(std::span<const std::byte> page, uint32_t index) const {
  static const TexelReader<3, true> kReader(TexelLayout{});
  return glm::vec3(kReader(page.data(), index)) * scale_;
}

}  // namespace quarry
