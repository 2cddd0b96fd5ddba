#include "master/display/picker.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/engine/surfaces/section_clip.h"
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
  std::array<glm::dvec3, 3> corners{};
  bool cap = false;  ///< the cut through a closed part, in front of the triangle
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
  return PickedSurface{ray.origin + along * ray.direction,
                       (slope > 0 ? -across : across) / length,
                       {a, b, c},
                       false,
                       hot.materials[hit.local],
                       hot.part(hit.local)};
}

/// Moves a surface to the cut before it, where the view draws a cap.
void PutCap(const View& view, const SceneMeta& meta, const RayQuery& ray, PickedSurface& surface) {
  const PartSelection* parts = view.parts.selection.get();
  if (view.section.empty() || !view.section.caps || !parts || !HasPart(parts->closed, surface.part)) return;
  const auto& [a, b, c] = surface.corners;
  const bool entering = glm::dot(glm::cross(b - a, c - a), ray.direction) < 0;
  if (entering != HasPart(parts->inverted, surface.part)) return;
  const SectionClip clip(view.section, meta);
  const SectionClip::Entry entry = clip.EntryOf(ray.origin, ray.direction);
  if (!(entry.t > 0)) return;
  surface.point = ray.origin + entry.t * ray.direction;
  surface.normal = clip.normal(entry.plane);
  surface.cap = true;
}

ordered_json Vector(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

ordered_json Describe(const PickedSurface& surface, double distance, const RayDone& hit, const Scene& scene,
                      const PartTree& parts) {
  const bool known = surface.part < parts.size();
  const glm::dvec3& offset = scene.catalog().meta.offset;
  const auto& [a, b, c] = surface.corners;
  ordered_json corners;  // of a cap none: its triangle is not seen
  if (!surface.cap) corners = {Vector(a + offset), Vector(b + offset), Vector(c + offset)};
  return {{"position", Vector(surface.point + offset)},
          {"distance", distance},
          {"normal", Vector(surface.normal)},
          {"corners", std::move(corners)},
          {"cap", surface.cap},
          {"part_id", surface.part},
          {"part", known ? parts.name(surface.part) : ""},
          {"part_path", known ? parts.Path(surface.part) : ""},
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
  const RayQuery ray = RayOf(pick, view);
  if (!CheckRay(ray))
    return (*answer_)(AnswerText(pick.pick, nullptr));  // so far away that nothing is visible
  const glm::dvec3 from = pick.ray ? ray.origin : view.camera.eye;
  const uint32_t number =
      rays_.Ask(ray, view, [this, number = pick.pick, ray, from, view](const RayDone& hit) {
        asked_.erase(hit.ray);
        OnHit(number, ray, from, view, hit);
      });
  asked_.emplace(number, pick.pick);
}

RayQuery Picker::RayOf(const PickMessage& pick, const View& view) const {
  if (pick.ray) return *pick.ray;
  const auto place = [](double at, uint32_t length) {
    return at > 0 ? std::floor(std::min(at, static_cast<double>(length - 1))) : 0;
  };
  const SceneMeta& meta = scene_.catalog().meta;
  const Camera camera(view.camera, view.width, view.height, meta.root_lower, meta.root_upper);
  return camera.Query(place(pick.x, view.width) + 0.5, place(pick.y, view.height) + 0.5);
}

void Picker::OnHit(uint64_t pick, const RayQuery& ray, const glm::dvec3& eye, const View& view,
                   const RayDone& hit) {
  if (hit.triangle == kNoIndex || hit.voxel >= scene_.catalog().voxels.size())
    return (*answer_)(AnswerText(pick, nullptr));
  source_.Fetch(BlockKey::Hot(hit.voxel), [&scene = scene_, &selections = selections_, pick, ray, eye, view,
                                           hit, weak = std::weak_ptr(answer_)](const Result<Bytes>& stored) {
    const auto answer = weak.lock();
    if (!answer) return;
    auto surface =
        stored.and_then([&](const Bytes& bytes) { return FindSurface(scene.catalog(), hit, ray, bytes); });
    if (!surface) return (*answer)(AnswerText(pick, nullptr, "error", surface.error().message));
    PutCap(view, scene.catalog().meta, ray, *surface);
    const auto parts = selections.Parts();
    if (!parts) return (*answer)(AnswerText(pick, nullptr, "error", parts.error().message));
    const double distance = glm::dot(surface->point - eye, ray.direction);
    (*answer)(AnswerText(pick, Describe(*surface, distance, hit, scene, **parts)));
  });
}

}  // namespace quarry
