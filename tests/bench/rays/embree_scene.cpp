#include "tests/bench/rays/embree_scene.h"

#include <algorithm>
#include <utility>

namespace quarry::bench {

EmbreeScene::EmbreeScene(std::span<const VoxelGeometry> voxels, uint64_t triangles, bool robust)
    : device_(rtcNewDevice("threads=2,set_affinity=0")), scene_(rtcNewScene(device_)) {
  std::vector<bool> seen(triangles);
  std::vector<glm::vec3> corners;
  for (uint32_t v = 0; v < voxels.size(); ++v)
    for (uint32_t t = 0; t < voxels[v].triangle_count; ++t) {
      const uint32_t id = voxels[v].triangle_ids[t];
      if (seen[id]) continue;
      seen[id] = true;
      places_.push_back({id, v, t});
      for (int k = 0; k < 3; ++k) corners.push_back(voxels[v].vertex(t, k));
    }
  rtcSetSceneBuildQuality(scene_, RTC_BUILD_QUALITY_HIGH);
  rtcSetSceneFlags(scene_, robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
  RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_HIGH);
  auto* vertices = static_cast<glm::vec3*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3), corners.size()));
  auto* indices = static_cast<uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, corners.size() / 3));
  std::copy(corners.begin(), corners.end(), vertices);
  for (uint32_t i = 0; i < corners.size(); ++i) indices[i] = i;
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene_, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene_);
}

EmbreeScene::EmbreeScene(EmbreeScene&& other) noexcept
    : device_(std::exchange(other.device_, nullptr)),
      scene_(std::exchange(other.scene_, nullptr)),
      places_(std::move(other.places_)) {}

EmbreeScene::~EmbreeScene() {
  if (scene_) rtcReleaseScene(scene_);
  if (device_) rtcReleaseDevice(device_);
}

}  // namespace quarry::bench
