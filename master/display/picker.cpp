#include "master/display/picker.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/scene/camera.h"

namespace quarry {
namespace {

using nlohmann::ordered_json;

/// Layers of a pick, in the order of their words.
constexpr Aov kLayers[] = {Aov::kDepth,    Aov::kNormal, Aov::kPrimitive,
                           Aov::kMaterial, Aov::kPart,   Aov::kVoxel};

/// A pixel with the layers of a pick.
struct PickedPixel {
  float color[3];
  float depth;
  float normal[3];
  uint32_t primitive, material, part, voxel;
};
static_assert(sizeof(PickedPixel) == 11 * 4);

std::string NameOf(const std::vector<std::string>& names, uint32_t index) {
  return index < names.size() ? names[index] : std::string();
}

ordered_json Describe(const PickedPixel& pixel, const View& view, const Scene& scene) {
  if (!std::isfinite(pixel.depth)) return nullptr;
  const SceneMeta& meta = scene.catalog().meta;
  const Camera camera(view.camera, view.width, view.height, meta.root_lower, meta.root_upper);
  const PrimaryRay ray = camera.Shoot(view.crop.x + 0.5, view.crop.y + 0.5);
  const double along = static_cast<double>(pixel.depth) - static_cast<double>(ray.t_offset);
  const glm::dvec3 at = glm::dvec3(ray.origin) + glm::dvec3(ray.direction) * along + meta.offset;
  return {{"position", {at.x, at.y, at.z}},
          {"distance", pixel.depth},
          {"normal", {pixel.normal[0], pixel.normal[1], pixel.normal[2]}},
          {"part", NameOf(scene.store().parts(), pixel.part)},
          {"material", NameOf(scene.store().material_names(), pixel.material)},
          {"triangle", pixel.primitive},
          {"voxel", pixel.voxel}};
}

}  // namespace

void Picker::Ask(const PickMessage& pick, View view) {
  if (asked_.size() >= kMost) {
    dispatcher_.End(asked_.begin()->first);
    asked_.erase(asked_.begin());
  }
  const auto place = [](double at, uint32_t length) {
    return at > 0 ? static_cast<uint32_t>(std::min(at, static_cast<double>(length - 1))) : 0;
  };
  view.crop = {place(pick.x, view.width), place(pick.y, view.height), 1, 1};
  view.spp = 1;
  view.mode = RenderMode::kRaycast;
  view.aov_mask = 0;
  for (const Aov layer : kLayers) view.aov_mask |= 1u << static_cast<int>(layer);
  const FrameId frame = dispatcher_.Begin(viewer_, view);
  dispatcher_.Trace(frame, {view.crop}, LiveUrgency::kAnswer);
  asked_.emplace(frame, Asked{pick.pick, std::move(view)});
}

std::string Picker::Take(const LiveTile& tile, std::span<const std::byte> pixels) {
  const auto it = asked_.find(tile.frame);
  PickedPixel pixel;
  if (it == asked_.end() || pixels.size() != sizeof pixel) return {};
  std::memcpy(&pixel, pixels.data(), sizeof pixel);
  const ordered_json answer{
      {"type", "picked"}, {"pick", it->second.pick}, {"hit", Describe(pixel, it->second.view, scene_)}};
  dispatcher_.End(tile.frame);
  asked_.erase(it);
  return answer.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace quarry
