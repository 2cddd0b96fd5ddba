#include "common/engine/shading/shading.h"

#include "common/math/random.h"

namespace quarry {

void AddAttributes(const VoxelShading& shading, const Hit& hit, Surface& s) {
  AddAttributes(shading.vertex(hit.local, 0), shading.vertex(hit.local, 1), shading.vertex(hit.local, 2),
                hit.b1, hit.b2, s);
}

glm::vec3 VoxelColor(uint32_t voxel) {
  const uint64_t h = Mix64(voxel + 0x9E3779B97F4A7C15ull);
  const auto channel = [&](int shift) {
    return 0.25f + 0.75f * static_cast<float>(h >> shift & 255) / 255.0f;
  };
  return {channel(0), channel(8), channel(16)};
}

}  // namespace quarry
