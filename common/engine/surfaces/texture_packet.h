#pragma once

#include <cstdint>

#include "common/engine/surfaces/scene_surfaces.h"
#include "common/engine/surfaces/surface_packet.h"
#include "common/engine/surfaces/texture_filter.h"
#include "common/engine/surfaces/texture_lookups.h"

// The functions of texture_frame.h and texture_filter.h for all samples of a packet, with the same bits:
// loops over lanes that become vector instructions. Bit i of `lanes` selects lane i; other lanes are not
// changed. Thread-safe.

namespace quarry {

/// A FilterFootprint per lane, one array per field.
struct FootprintPacket {
  uint32_t level[RayPacket::kRays];  ///< the finer one
  float share[RayPacket::kRays];     ///< of the coarser one
  struct Texels {
    uint32_t x[2][RayPacket::kRays], y[2][RayPacket::kRays];
    float fx[RayPacket::kRays], fy[RayPacket::kRays];
    uint32_t width[RayPacket::kRays], height[RayPacket::kRays];  ///< of the level
  } texels[2];

  FilterFootprint operator[](int i) const {
    FilterFootprint f;
    f.count = share[i] > 0 ? 2 : 1;
    for (uint32_t k = 0; k < f.count; ++k) {
      const Texels& t = texels[k];
      f.levels[k] = {level[i] + k,
                     k == 1 ? share[i] : 1 - share[i],
                     {t.x[0][i], t.x[1][i]},
                     {t.y[0][i], t.y[1][i]},
                     t.fx[i],
                     t.fy[i]};
    }
    return f;
  }
};

/// The texels of lookups, by trilinear interpolation between two levels.
/// Units: `u`, `v` as in the model; `lod`: see TextureLookups. A point of the image that is not finite,
/// or beyond 2^20 images, counts as (0, 0). Source: Williams 1983, "Pyramidal Parametrics".
void MakeFootprints(const SurfaceTexture& texture, const TexturePyramid& pyramid,
                    const float (&u)[RayPacket::kRays], const float (&v)[RayPacket::kRays],
                    const float (&lod)[RayPacket::kRays], uint64_t lanes, FootprintPacket& footprints);

/// Places and values of texels, for lookups of 8-bit texels whose pages are all in memory.
struct TexelPacket {
  static constexpr uint32_t kMost = 8;     ///< texels of a lookup
  uint32_t page[kMost][RayPacket::kRays];  ///< as BlockKey::Page() counts pages
  uint32_t index[kMost][RayPacket::kRays];
  uint32_t codes[kMost][RayPacket::kRays];  ///< a texel's channels from the lowest byte on
};
/// Sets `page` and `index`.
void PlaceTexels(const TexturePyramid& pyramid, const FootprintPacket& footprints, uint64_t lanes,
                 TexelPacket& texels);
/// The channels of a texel of 8 bits a channel, from the lowest byte on. `page_bytes`: the bytes of the whole
/// page.
inline uint32_t CodesAt(const std::byte* page, size_t page_bytes, uint32_t index, uint32_t channels) {
  const size_t at = size_t{channels} * index;
  uint32_t codes = 0;
  if (at + sizeof codes <= page_bytes)
    std::memcpy(&codes, page + at, sizeof codes);
  else
    std::memcpy(&codes, page + at, channels);
  return codes;
}
/// Sums complete lookups, to the same bits as GoOnLookup(). Requires: texels of 8 bits a channel; `codes` are
/// set.
void SumTexels(const TexturePyramid& pyramid, const FootprintPacket& footprints, const TexelPacket& texels,
               LookupKind kind, uint64_t lanes, TextureLookups& lookups);

/// Begins the lookups of the triangles that `rays` have hit: their edges, and the cones' widths at the hits.
void BeginTextureFrames(const TrianglePacket& triangles, const RayPacket& rays, uint64_t lanes,
                        TextureLookups& lookups);

/// Computes frame, level of detail and curvature of the triangles that were hit, from their edges and
/// attributes.
void MakeTextureFrames(const AttributePacket& attributes, const SurfacePacket& surfaces, uint64_t lanes,
                       TextureLookups& lookups);

/// Sets the normals from complete lookups of a normal or bump map.
void MapNormals(const SurfaceTexture& texture, const TexturePyramid& pyramid, const TextureLookups& lookups,
                uint64_t lanes, SurfacePacket& surfaces);

}  // namespace quarry
