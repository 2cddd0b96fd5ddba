#pragma once

#include <algorithm>
#include <cstdint>

#include "common/engine/surfaces/scene_surfaces.h"
#include "common/engine/surfaces/surface_packet.h"

namespace quarry {

/// The colour of a complete lookup: at least 0, and at most `most`.
inline glm::vec3 ColorOf(const SurfaceTexture& texture, const glm::vec4& texels_sum, float most) {
  const glm::vec4 value = texture.binding.factor * texels_sum;
  const auto within = [&](float x) { return x > 0 ? std::min(x, most) : 0.0f; };
  return {within(value.x), within(value.y), within(value.z)};
}
inline glm::vec3 BaseColorOf(const SurfaceTexture& texture, const glm::vec4& texels_sum) {
  return ColorOf(texture, texels_sum, 1);
}
inline glm::vec3 EmissionOf(const SurfaceTexture& texture, const glm::vec4& texels_sum) {
  return ColorOf(texture, texels_sum, 1e30f);
}

/// The texture lookups of a packet's samples, one array per field. Tiles of scenes without
/// textures have none. Memory: 6,592 bytes.
struct TextureLookups {
  static constexpr int kLanes = RayPacket::kRays;
  uint64_t looked_up;  ///< lanes whose lookups are all complete
  /// Lanes whose emission is looked up in level 0, as light rays do: lights could have chosen their path's
  /// ray.
  uint64_t sharp_emission;
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
    const glm::vec3 color = BaseColorOf(of, texels_sum);
    switch (of.binding.use) {
      case TextureUse::kDiffuse:
        return base.Set(i, color);
      case TextureUse::kSpecular:
        return specular.Set(i, color);
      case TextureUse::kEmission:
        return emission.Set(i, EmissionOf(of, texels_sum));
      case TextureUse::kMetalRoughness:
        roughness[i] = color.y;
        metalness[i] = color.z;
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
