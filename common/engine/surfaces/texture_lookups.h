#pragma once

#include <algorithm>
#include <cstdint>

#include "common/engine/surfaces/scene_surfaces.h"
#include "common/engine/surfaces/surface_packet.h"

namespace quarry {

/// The texture lookups of a packet's samples, one array per field. Tiles of scenes without
/// textures have none. Memory: 6,592 bytes.
struct TextureLookups {
  static constexpr int kLanes = RayPacket::kRays;
  uint64_t looked_up;  ///< lanes whose lookups are all complete
  // The cone of a pending ray, or of a ray that has hit. Source: Akenine-Moeller et al. 2021, ray cones.
  float cone_width[kLanes];   ///< at the ray's origin, then at its hit; scene units
  float cone_spread[kLanes];  ///< growth of the width with the distance
  // Of the surface that was hit.
  Vectors by_u, by_v;     ///< see TextureFrame; the triangle's edges until the attributes are there
  float lod[kLanes];      ///< see LodOf()
  float bending[kLanes];  ///< curvature of the surface, positive where it bulges outward; 1 over scene units
  Vectors base, specular, emission;
  float roughness[kLanes], metalness[kLanes];
  // The lookup under way.
  float sum[4][kLanes];
  uint8_t texture[kLanes];  ///< number among the material's textures
  uint8_t texels[kLanes];

  TextureValues ValuesOf(int i) const {
    return {base[i], specular[i], emission[i], roughness[i], metalness[i]};
  }
  /// Stores the value of a complete lookup: colours at least 0, and, except emission, at most 1.
  void Put(int i, const SurfaceTexture& of, const glm::vec4& texels_sum) {
    const auto within = [](float value, float most) { return value > 0 ? std::min(value, most) : 0.0f; };
    const auto color = [&](const glm::vec4& v, float most) {
      return glm::vec3(within(v.x, most), within(v.y, most), within(v.z, most));
    };
    constexpr float kMost = 1e30f;
    const glm::vec4 value = of.binding.factor * texels_sum;
    switch (of.binding.use) {
      case TextureUse::kDiffuse:
        return base.Set(i, color(value, 1));
      case TextureUse::kSpecular:
        return specular.Set(i, color(value, 1));
      case TextureUse::kEmission:
        return emission.Set(i, color(value, kMost));
      case TextureUse::kMetalRoughness:
        roughness[i] = within(value.y, 1);
        metalness[i] = within(value.z, 1);
        return;
      default:
        return;
    }
  }
  TextureLookup LookupOf(int i) const { return {texels[i], {sum[0][i], sum[1][i], sum[2][i], sum[3][i]}}; }
  void SetLookup(int i, const TextureLookup& lookup) {
    texels[i] = static_cast<uint8_t>(lookup.texels);
    for (int c = 0; c < 4; ++c) sum[c][i] = lookup.sum[c];
  }
};

}  // namespace quarry
