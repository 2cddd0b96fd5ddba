#include "common/voxel/view_sections.h"

#include <fmt/format.h>

namespace quarry {
namespace {

constexpr size_t kCameraBytes = 96, kLightBytes = 64;
/// Follows the entry of a rectangle: its sides.
constexpr uint32_t kSidesEntry = 3;

uint32_t AddName(const std::string& name, std::string& strings) {
  const auto at = static_cast<uint32_t>(strings.size());
  strings.append(name).push_back('\0');
  return at;
}

}  // namespace

Bytes EncodeCameras(const std::vector<NamedCamera>& cameras, std::string& strings) {
  ByteWriter out;
  for (const NamedCamera& camera : cameras) {
    out.Put(AddName(camera.name, strings));
    out.Put(uint32_t{0});
    for (const glm::dvec3* v : {&camera.spec.eye, &camera.spec.at, &camera.spec.up}) out.PutVec3(*v);
    out.Put(camera.spec.fov_degrees);
    out.Put(camera.spec.ortho_height);
  }
  return out.Take();
}

Bytes EncodeLights(const std::vector<NamedLight>& lights, std::string& strings) {
  ByteWriter out;
  for (const NamedLight& light : lights) {
    out.Put(AddName(light.name, strings));
    out.Put(static_cast<uint32_t>(light.kind));
    out.PutVec3(light.position);
    out.PutVec3(light.direction);
    out.PutVec3(light.radiance);
    out.Put(light.cos_inner);
    out.Put(light.cos_outer);
    if (light.kind != LightKind::kRectangle) continue;
    out.Put(uint32_t{0});
    out.Put(kSidesEntry);
    for (const glm::vec3& edge : light.edges) out.PutVec3(edge);
    out.PutArray(std::array<uint32_t, 8>{});
  }
  return out.Take();
}

Result<std::vector<NamedCamera>> DecodeCameras(std::span<const std::byte> bytes, const NameLookup& name_at) {
  if (bytes.size() % kCameraBytes != 0 || bytes.size() / kCameraBytes > kMaxSceneCameras)
    return Fail("the CAMS section has the wrong size");
  ByteReader in(bytes);
  std::vector<NamedCamera> cameras(bytes.size() / kCameraBytes);
  for (size_t i = 0; i < cameras.size(); ++i) {
    NamedCamera& camera = cameras[i];
    QUARRY_ASSIGN(camera.name, name_at(in.Get<uint32_t>()));
    in.Get<uint32_t>();
    for (glm::dvec3* v : {&camera.spec.eye, &camera.spec.at, &camera.spec.up}) *v = in.GetVec3<glm::dvec3>();
    camera.spec.fov_degrees = in.Get<double>();
    camera.spec.ortho_height = in.Get<double>();
    if (!IsSane(camera.spec)) return Fail(fmt::format("the CAMS section's camera {} is invalid", i));
  }
  return cameras;
}

Result<std::vector<NamedLight>> DecodeLights(std::span<const std::byte> bytes, const NameLookup& name_at) {
  if (bytes.size() % kLightBytes != 0 || bytes.size() / kLightBytes > 2 * kMaxLights)
    return Fail("the LITE section has the wrong size");
  ByteReader in(bytes);
  std::vector<NamedLight> lights;
  while (in.remaining() > 0) {
    const size_t i = lights.size();
    NamedLight& light = lights.emplace_back();
    QUARRY_ASSIGN(light.name, name_at(in.Get<uint32_t>()));
    const auto kind = in.Get<uint32_t>();
    light.kind = static_cast<LightKind>(kind);
    light.position = in.GetVec3<glm::dvec3>();
    light.direction = in.GetVec3<glm::vec3>();
    light.radiance = in.GetVec3<glm::vec3>();
    light.cos_inner = in.Get<float>();
    light.cos_outer = in.Get<float>();
    bool right = kind < kLightKinds;
    if (kind == static_cast<uint32_t>(LightKind::kRectangle)) {
      right = in.Get<uint32_t>() == 0;
      right = in.Get<uint32_t>() == kSidesEntry && right;
      for (glm::vec3& edge : light.edges) edge = in.GetVec3<glm::vec3>();
      for (int rest = 0; rest < 8; ++rest) right = in.Get<uint32_t>() == 0 && right;
    }
    if (!right || !in.ok() || !IsSane(light) || i == kMaxLights)
      return Fail(fmt::format("the LITE section's light {} is invalid", i));
  }
  return lights;
}

}  // namespace quarry
