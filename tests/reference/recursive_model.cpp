#include "tests/reference/recursive_model.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <memory>

#include "common/voxel/block_decoder.h"

namespace quarry::test {
namespace {

glm::vec3 ColorOf(uint32_t packed) {
  const auto part = [&](int shift) { return static_cast<float>(packed >> shift & 255u) / 255; };
  return {part(0), part(8), part(16)};
}

template <class Value>
Value Needed(Result<Value> result) {
  INFO((result ? "" : result.error().message));
  REQUIRE(result.has_value());
  return *std::move(result);
}

/// Memory of a decoded block, aligned as decoders require.
struct alignas(16) Aligned {
  std::byte bytes[16];
};

}  // namespace

RecursiveModel::RecursiveModel(const StoreReader& store)
    : materials_(store.catalog().materials),
      device_(rtcNewDevice("threads=2,set_affinity=0")),
      scene_(rtcNewScene(device_)) {
  const Catalog& catalog = store.catalog();
  std::vector<bool> seen(catalog.meta.input_triangles);
  BlockDecoder decoder;
  std::vector<Aligned> memory[2];
  const auto room = [&](BlockKey key, std::vector<Aligned>& block) {
    const size_t bytes = catalog.block(key).decoded;
    block.resize((bytes + 15) / 16);
    return std::as_writable_bytes(std::span(block)).first(bytes);
  };
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v) {
    const BlockKey hot = BlockKey::Hot(v), cold = BlockKey::Shading(v);
    const Bytes stored = Needed(store.ReadBlock(hot));
    const VoxelGeometry geometry = Needed(DecodeHot(decoder, catalog, v, stored, room(hot, memory[0])));
    VoxelShading shading;
    if (catalog.Has(cold))
      shading =
          Needed(DecodeShading(decoder, catalog, v, Needed(store.ReadBlock(cold)), room(cold, memory[1])));
    for (uint32_t t = 0; t < geometry.triangle_count; ++t) {
      if (seen[geometry.triangle_ids[t]]) continue;
      seen[geometry.triangle_ids[t]] = true;
      Triangle triangle{};
      triangle.material = geometry.materials[t];
      for (int c = 0; c < 3; ++c) {
        const ShadingVertex vertex = shading.vertices ? shading.vertex(t, c) : ShadingVertex{};
        triangle.corners[c] = geometry.vertex(t, c);
        triangle.normals[c] = vertex.normal;
        triangle.colors[c] = ColorOf(vertex.color);
      }
      triangles_.push_back(triangle);
    }
  }
  const glm::vec3 reach = glm::max(glm::abs(catalog.meta.bounds_lower), glm::abs(catalog.meta.bounds_upper));
  // Floats of this size are exact to 6e-8 of it; hits are a few times less exact.
  offset_ = 4e-6 * static_cast<double>(std::max({reach.x, reach.y, reach.z}));
  Build();
}

RecursiveModel::~RecursiveModel() {
  rtcReleaseScene(scene_);
  rtcReleaseDevice(device_);
}

void RecursiveModel::Build() {
  rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                               RTC_FORMAT_FLOAT3, 12, triangles_.size() * 3));
  auto* indices = static_cast<uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles_.size()));
  for (size_t i = 0; i < triangles_.size() * 3; ++i) {
    std::memcpy(vertices + 3 * i, &triangles_[i / 3].corners[i % 3], 12);
    indices[i] = static_cast<uint32_t>(i);
  }
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene_, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene_);
}

std::optional<RecursiveModel::Found> RecursiveModel::Nearest(const glm::dvec3& origin,
                                                             const glm::dvec3& direction, double end) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  const glm::vec3 from(origin), along(direction);
  RTCRayHit r{};
  r.ray.org_x = from.x, r.ray.org_y = from.y, r.ray.org_z = from.z;
  r.ray.dir_x = along.x, r.ray.dir_y = along.y, r.ray.dir_z = along.z;
  r.ray.tfar = static_cast<float>(end);
  r.ray.mask = 0xFFFFFFFF;
  r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene_, &context, &r);
  if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return Found{r.hit.primID, static_cast<double>(r.ray.tfar), static_cast<double>(r.hit.u),
               static_cast<double>(r.hit.v)};
}

Meeting RecursiveModel::At(const Found& found, const glm::dvec3& direction) const {
  const Triangle& t = triangles_[found.triangle];
  const auto mixed = [&](const glm::vec3(&of)[3]) {
    return glm::dvec3(of[0]) * (1 - found.u - found.v) + glm::dvec3(of[1]) * found.u +
           glm::dvec3(of[2]) * found.v;
  };
  Meeting at;
  at.position = mixed(t.corners);
  at.color = mixed(t.colors);
  at.view = -direction;
  const glm::dvec3 a(t.corners[0]), b(t.corners[1]), c(t.corners[2]);
  const glm::dvec3 face = glm::normalize(glm::cross(b - a, c - a));
  at.entering = glm::dot(face, at.view) > 0;
  at.side = at.entering ? face : -face;
  // A shading normal has the side of the triangle's normal. One that faces away from the viewer, or has no
  // length, does not count.
  glm::dvec3 normal = mixed(t.normals);
  if (glm::dot(normal, at.side) < 0) normal = -normal;
  const bool counts = glm::dot(normal, normal) > 1e-12 && glm::dot(normal, at.view) > 0;
  at.normal = counts ? glm::normalize(normal) : at.side;
  return at;
}

}  // namespace quarry::test
