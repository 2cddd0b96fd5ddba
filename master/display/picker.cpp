#include "master/display/picker.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "common/scene/camera.h"
#include "common/voxel/block_decoder.h"

namespace quarry {
namespace {

using nlohmann::ordered_json;

/// Layers of a pick, in the order of their words.
constexpr Aov kLayers[] = {Aov::kDepth,    Aov::kNormal, Aov::kPrimitive,
                           Aov::kMaterial, Aov::kPart,   Aov::kVoxel};

/// A pixel with the layers of a pick.
struct PickedPixel {
  float color[3], coverage;
  float depth;
  float normal[3];
  uint32_t primitive, material, part, voxel;
};
static_assert(sizeof(PickedPixel) == 4 * (kColorWords + 8));

/// The point that a pick hits, by the triangle's vertices in double: a traced depth has the precision of a
/// float, and a traced normal may be an interpolated one.
struct PickedPoint {
  double along = 0;     ///< the ray, scene units
  glm::dvec3 normal{};  ///< of the face, toward the ray's origin
};

std::optional<PickedPoint> PointOf(const VoxelGeometry& voxel, uint32_t local, const PrimaryRay& ray) {
  const glm::dvec3 a(voxel.vertex(local, 0)), b(voxel.vertex(local, 1)), c(voxel.vertex(local, 2));
  const glm::dvec3 across = glm::cross(b - a, c - a), direction(ray.direction);
  const double length = glm::length(across);
  if (!(length > 0)) return std::nullopt;
  const glm::dvec3 normal = across / length;
  const double slope = glm::dot(normal, direction);
  if (slope == 0) return std::nullopt;
  return PickedPoint{glm::dot(normal, a - glm::dvec3(ray.origin)) / slope, slope > 0 ? -normal : normal};
}

/// None: the block does not decode or lacks the triangle, or the ray runs along it.
std::optional<PickedPoint> FindPoint(const Catalog& catalog, const PickedPixel& pixel,
                                     std::span<const std::byte> stored, const PrimaryRay& ray) {
  BlockDecoder decoder;
  Bytes memory(catalog.block(BlockKey::Hot(pixel.voxel)).decoded);
  const auto hot = DecodeHot(decoder, catalog, pixel.voxel, stored, memory);
  if (!hot) return std::nullopt;
  for (uint32_t local = 0; local < hot->triangle_count; ++local)
    if (hot->triangle_ids[local] == pixel.primitive) return PointOf(*hot, local, ray);
  return std::nullopt;
}

PrimaryRay RayOf(const View& view, const SceneMeta& meta) {
  const Camera camera(view.camera, view.width, view.height, meta.root_lower, meta.root_upper);
  return camera.Shoot(view.crop.x + 0.5, view.crop.y + 0.5);
}

/// What was hit, of a pixel that shows a surface; `point`: none when it could not be had, for the traced one.
ordered_json Describe(const PickedPixel& pixel, const std::optional<PickedPoint>& point,
                      const PrimaryRay& ray, const Scene& scene) {
  const auto offset = static_cast<double>(ray.t_offset);
  const double along = point ? point->along : static_cast<double>(pixel.depth) - offset;
  const glm::dvec3 normal =
      point ? point->normal : glm::dvec3(pixel.normal[0], pixel.normal[1], pixel.normal[2]);
  const glm::dvec3 at =
      glm::dvec3(ray.origin) + glm::dvec3(ray.direction) * along + scene.catalog().meta.offset;
  return {{"position", {at.x, at.y, at.z}},
          {"distance", along + offset},
          {"normal", {normal.x, normal.y, normal.z}},
          {"part", scene.store().PartName(pixel.part).value_or("")},
          {"material", scene.store().MaterialName(pixel.material).value_or("")},
          {"triangle", pixel.primitive},
          {"voxel", pixel.voxel}};
}

std::string AnswerText(uint64_t pick, ordered_json hit, bool replaced = false) {
  ordered_json answer{{"type", "picked"}, {"pick", pick}, {"hit", std::move(hit)}};
  if (replaced) answer["replaced"] = true;
  return answer.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace

void Picker::Ask(const PickMessage& pick, View view) {
  if (asked_.size() >= kMost) {
    const auto [oldest, replaced] = std::pair(asked_.begin()->first, asked_.begin()->second.pick);
    dispatcher_.End(oldest);
    asked_.erase(oldest);
    (*answer_)(AnswerText(replaced, nullptr, true));
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

bool Picker::Take(const LiveTile& tile, std::span<const std::byte> pixels) {
  const auto it = asked_.find(tile.frame);
  PickedPixel pixel;
  if (it == asked_.end() || pixels.size() != sizeof pixel) return false;
  std::memcpy(&pixel, pixels.data(), sizeof pixel);
  const Asked asked = std::move(it->second);
  dispatcher_.End(tile.frame);
  asked_.erase(it);
  if (!std::isfinite(pixel.depth) || pixel.voxel >= scene_.catalog().voxels.size()) {
    (*answer_)(AnswerText(asked.pick, nullptr));
    return true;
  }
  const PrimaryRay ray = RayOf(asked.view, scene_.catalog().meta);
  source_.Fetch(BlockKey::Hot(pixel.voxel), [&scene = scene_, pixel, ray, pick = asked.pick,
                                             weak = std::weak_ptr(answer_)](const Result<Bytes>& stored) {
    const auto answer = weak.lock();
    if (!answer) return;
    const auto point = stored ? FindPoint(scene.catalog(), pixel, *stored, ray) : std::nullopt;
    (*answer)(AnswerText(pick, Describe(pixel, point, ray, scene)));
  });
  return true;
}

}  // namespace quarry
