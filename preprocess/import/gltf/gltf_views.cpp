#include "preprocess/import/gltf/gltf_views.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "preprocess/import/gltf/gltf_material.h"
#include "preprocess/import/gltf/gltf_nodes.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

constexpr double kPi = 3.14159265358979323846;

std::string NameOf(const Json& node, const Json& thing, const char* kind, uint64_t index) {
  std::string name = node.value("name", "");
  if (name.empty()) name = thing.value("name", "");
  return name.empty() ? fmt::format("{} {}", kind, index) : name;
}

/// The direction of a node's z axis; its cameras and lights look the other way.
glm::dvec3 Backward(const glm::dmat4& world) {
  const glm::dvec3 z(world[2]);
  const double length = glm::length(z);
  return length > 0 ? z / length : glm::dvec3(0, 0, 1);
}

Status AddCamera(const GltfDocument& document, const GltfNodes::Node& node, ModelSink& sink) {
  QUARRY_ASSIGN(const uint64_t index,
                document.Unsigned(*node.json, fmt::format("nodes[{}]", node.index), "camera"));
  QUARRY_ASSIGN(const Json* json, document.Find("cameras", index));
  NamedCamera camera;
  camera.name = NameOf(*node.json, *json, "camera", index);
  camera.spec.eye = glm::dvec3(node.world[3]);
  camera.spec.at = camera.spec.eye - Backward(node.world);
  camera.spec.up = glm::dvec3(node.world[1]);
  if (json->value("type", "perspective") == "orthographic") {
    camera.spec.ortho_height = 2 * std::fabs(Member(*json, "orthographic").value("ymag", 1.0));
  } else {
    const double degrees = Member(*json, "perspective").value("yfov", kPi / 4) * 180 / kPi;
    camera.spec.fov_degrees = std::clamp(degrees, 0.01, 179.0);
  }
  sink.AddCamera(std::move(camera));
  return {};
}

Status AddLight(const GltfDocument& document, const GltfNodes::Node& node, const Json& reference,
                ModelSink& sink) {
  QUARRY_ASSIGN(const uint64_t index,
                document.Unsigned(reference, fmt::format("nodes[{}]", node.index), "light"));
  const Json& all = Member(Member(document.json(), "extensions"), "KHR_lights_punctual");
  const auto lights = all.find("lights");
  if (lights == all.end() || !lights->is_array() || index >= lights->size() || !(*lights)[index].is_object())
    return document.FailAt(fmt::format("KHR_lights_punctual.lights[{}] is not there", index));
  const Json& json = (*lights)[index];
  NamedLight light;
  light.name = NameOf(*node.json, json, "light", index);
  const std::string type = json.value("type", "");
  glm::vec3 color(1);
  ReadNumbers(json, "color", 3, color);
  const double intensity = json.value("intensity", 1.0);
  light.radiance =
      glm::max(color, glm::vec3(0)) * Bounded(static_cast<float>(std::max(intensity, 0.0) / kPi));
  light.position = glm::dvec3(node.world[3]);
  light.kind = type == "directional" ? LightKind::kSun : LightKind::kPoint;
  light.direction = glm::vec3(Backward(node.world));
  if (light.kind == LightKind::kPoint) light.direction = -light.direction;
  if (type == "spot") {
    const Json& spot = Member(json, "spot");
    const auto angle = [&](const char* key, double fallback) {
      return static_cast<float>(std::cos(std::clamp(spot.value(key, fallback), 0.0, kPi / 2)));
    };
    light.cos_outer = angle("outerConeAngle", kPi / 4);
    light.cos_inner = std::max(angle("innerConeAngle", 0), light.cos_outer);
  }
  sink.AddLight(std::move(light));
  return {};
}

}  // namespace

Status ReadGltfViews(const GltfDocument& document, ModelSink& sink) {
  QUARRY_ASSIGN(GltfNodes nodes, GltfNodes::Open(document));
  for (;;) {
    QUARRY_ASSIGN(const std::optional<GltfNodes::Node> node, nodes.Next());
    if (!node) return {};
    if (node->json->contains("camera")) QUARRY_TRY(AddCamera(document, *node, sink));
    const Json& light = Member(Member(*node->json, "extensions"), "KHR_lights_punctual");
    if (light.contains("light")) QUARRY_TRY(AddLight(document, *node, light, sink));
  }
}

}  // namespace quarry
