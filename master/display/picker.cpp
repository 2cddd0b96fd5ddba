#include "master/display/picker.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/scene/camera.h"
#include "common/voxel/block_decoder.h"

namespace quarry {
namespace {

using nlohmann::ordered_json;

/// The surface that a ray hits, computed in double from the triangle's vertices: a traced distance is a float
/// only, and a shading normal may be interpolated.
struct PickedSurface {
  glm::dvec3 point{};   ///< scene units
  glm::dvec3 normal{};  ///< of the face, toward the ray's origin
  uint32_t material = 0, part = 0;
};

/// Errors: the block does not decode; the triangle is not there, or has no point on the ray's line.
Result<PickedSurface> FindSurface(const Catalog& catalog, const RayDone& hit, const RayQuery& ray,
                                  std::span<const std::byte> stored) {
  BlockDecoder decoder;
  Bytes memory(catalog.block(BlockKey::Hot(hit.voxel)).decoded);
  QUARRY_ASSIGN(const VoxelGeometry hot, DecodeHot(decoder, catalog, hit.voxel, stored, memory));
  if (hit.local >= hot.triangle_count || hot.triangle_ids[hit.local] != hit.triangle)
    return Fail("the triangle is not in its voxel");
  const glm::dvec3 a(hot.vertex(hit.local, 0)), b(hot.vertex(hit.local, 1)), c(hot.vertex(hit.local, 2));
  const glm::dvec3 across = glm::cross(b - a, c - a);
  const double length = glm::length(across), slope = glm::dot(across, ray.direction);
  if (!(length > 0) || slope == 0) return Fail("the triangle is seen from its edge");
  const double along = glm::dot(across, a - ray.origin) / slope;
  return PickedSurface{ray.origin + along * ray.direction, (slope > 0 ? -across : across) / length,
                       hot.materials[hit.local], hot.part(hit.local)};
}

ordered_json Describe(const PickedSurface& surface, double distance, const RayDone& hit, const Scene& scene) {
  const glm::dvec3 at = surface.point + scene.catalog().meta.offset;
  const glm::dvec3& normal = surface.normal;
  return {{"position", {at.x, at.y, at.z}},
          {"distance", distance},
          {"normal", {normal.x, normal.y, normal.z}},
          {"part", scene.store().PartName(surface.part).value_or("")},
          {"material", scene.store().MaterialName(surface.material).value_or("")},
          {"triangle", hit.triangle},
          {"voxel", hit.voxel}};
}

std::string AnswerText(uint64_t pick, ordered_json hit, const char* more = nullptr, ordered_json value = {}) {
  ordered_json answer{{"type", "picked"}, {"pick", pick}, {"hit", std::move(hit)}};
  if (more) answer[more] = std::move(value);
  return answer.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace

Picker::~Picker() {
  for (const auto& [ray, pick] : asked_) rays_.Forget(ray);
}

void Picker::Ask(const PickMessage& pick, const View& view) {
  if (asked_.size() >= kMost) {
    const auto [ray, replaced] = *asked_.begin();
    rays_.Forget(ray);
    asked_.erase(ray);
    (*answer_)(AnswerText(replaced, nullptr, "replaced", true));
  }
  const auto place = [](double at, uint32_t length) {
    return at > 0 ? std::floor(std::min(at, static_cast<double>(length - 1))) : 0;
  };
  const SceneMeta& meta = scene_.catalog().meta;
  const Camera camera(view.camera, view.width, view.height, meta.root_lower, meta.root_upper);
  const RayQuery ray = camera.Query(place(pick.x, view.width) + 0.5, place(pick.y, view.height) + 0.5);
  if (!CheckRay(ray))
    return (*answer_)(AnswerText(pick.pick, nullptr));  // so far away that nothing is visible
  const uint32_t number =
      rays_.Ask(ray, view, [this, number = pick.pick, ray, eye = view.camera.eye](const RayDone& hit) {
        asked_.erase(hit.ray);
        OnHit(number, ray, eye, hit);
      });
  asked_.emplace(number, pick.pick);
}

void Picker::OnHit(uint64_t pick, const RayQuery& ray, const glm::dvec3& eye, const RayDone& hit) {
  if (hit.triangle == kNoIndex || hit.voxel >= scene_.catalog().voxels.size())
    return (*answer_)(AnswerText(pick, nullptr));
  source_.Fetch(BlockKey::Hot(hit.voxel), [&scene = scene_, pick, ray, eye, hit,
                                           weak = std::weak_ptr(answer_)](const Result<Bytes>& stored) {
    const auto answer = weak.lock();
    if (!answer) return;
    const auto surface =
        stored.and_then([&](const Bytes& bytes) { return FindSurface(scene.catalog(), hit, ray, bytes); });
    if (!surface) return (*answer)(AnswerText(pick, nullptr, "error", surface.error().message));
    const double distance = glm::dot(surface->point - eye, ray.direction);
    (*answer)(AnswerText(pick, Describe(*surface, distance, hit, scene)));
  });
}

}  // namespace quarry
