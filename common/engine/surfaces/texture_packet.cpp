#include "common/engine/surfaces/texture_packet.h"

#include <utility>

#include "common/engine/surfaces/for_lanes.h"
#include "common/engine/surfaces/texture_frame.h"

namespace quarry {
namespace {

/// TexelsAlong() for the positions in images with the sides `sizes`.
template <TextureWrap kWrap>
void TexelsAlongLanes(const float (&positions)[RayPacket::kRays], const uint32_t (&sizes)[RayPacket::kRays],
                      uint64_t lanes, uint32_t (&texels)[2][RayPacket::kRays],
                      float (&weights)[RayPacket::kRays]) {
  ForLanes(lanes, [&](int i, bool meant) {
    uint32_t first = 0, second = 0;
    float weight = 0;
    TexelsAlong<kWrap>(positions[i], sizes[i], first, second, weight);
    Put(meant, i, first, texels[0]);
    Put(meant, i, second, texels[1]);
    Put(meant, i, weight, weights);
  });
}

void TexelsAlongLanes(TextureWrap wrap, const float (&positions)[RayPacket::kRays],
                      const uint32_t (&sizes)[RayPacket::kRays], uint64_t lanes,
                      uint32_t (&texels)[2][RayPacket::kRays], float (&weights)[RayPacket::kRays]) {
  switch (wrap) {
    case TextureWrap::kRepeat:
      return TexelsAlongLanes<TextureWrap::kRepeat>(positions, sizes, lanes, texels, weights);
    case TextureWrap::kClamp:
      return TexelsAlongLanes<TextureWrap::kClamp>(positions, sizes, lanes, texels, weights);
    case TextureWrap::kMirror:
      return TexelsAlongLanes<TextureWrap::kMirror>(positions, sizes, lanes, texels, weights);
  }
}

using Sums = float[4][RayPacket::kRays];

/// Adds the texels of lookups to their sums, as AddTexel() does, in its order. kChannels 0: slopes.
template <uint32_t kChannels>
void SumTexels(const float* colors, const FootprintPacket& footprints, const TexelPacket& texels,
               uint64_t lanes, Sums& sums) {
  const float* const linear = TexelCodes::Get().linear;
  ForLanes(lanes, [&](int i, bool meant) {
    float sum[4] = {sums[0][i], sums[1][i], sums[2][i], sums[3][i]};
    const float coarser = footprints.share[i];
    const auto add = [&]<uint32_t kN>(std::integral_constant<uint32_t, kN>) {
      constexpr bool kCoarser = kN >= 4, kRight = (kN & 1) != 0, kLower = (kN & 2) != 0;
      const FootprintPacket::Texels& t = footprints.texels[kCoarser ? 1 : 0];
      const float share = kCoarser ? coarser : 1 - coarser;
      const float across = kRight ? t.fx[i] : 1 - t.fx[i], down = kLower ? t.fy[i] : 1 - t.fy[i];
      const auto code = static_cast<int32_t>(texels.codes[kN][i]);
      const float first = colors[code & 255];
      float added[4] = {};
      if constexpr (kChannels == 0) {
        const float height = share * first;
        added[0] = (kRight ? height : -height) * down * static_cast<float>(static_cast<int32_t>(t.width[i]));
        added[1] =
            (kLower ? height : -height) * across * static_cast<float>(static_cast<int32_t>(t.height[i]));
      } else {
        const float weight = share * across * down;
        float second = first, third = first, last = 1;
        if constexpr (kChannels >= 3) {
          second = colors[code >> 8 & 255];
          third = colors[code >> 16 & 255];
        }
        if constexpr (kChannels % 2 == 0) last = linear[code >> (8 * (kChannels - 1)) & 255];
        added[0] = first * weight;
        added[1] = second * weight;
        added[2] = third * weight;
        added[3] = last * weight;
      }
      const bool there = !kCoarser || coarser > 0;
      for (int c = 0; c < (kChannels == 0 ? 2 : 4); ++c) sum[c] = there ? sum[c] + added[c] : sum[c];
    };
    [&]<uint32_t... kN>(std::integer_sequence<uint32_t, kN...>) {
      (add(std::integral_constant<uint32_t, kN>()), ...);
    }
    (std::make_integer_sequence<uint32_t, TexelPacket::kMost>());
    for (int c = 0; c < 4; ++c) Put(meant, i, sum[c], sums[c]);
  });
}

}  // namespace

void MakeFootprints(const SurfaceTexture& texture, const TexturePyramid& pyramid,
                    const float (&u)[RayPacket::kRays], const float (&v)[RayPacket::kRays],
                    const float (&lod)[RayPacket::kRays], uint64_t lanes, FootprintPacket& footprints) {
  alignas(64) float s[RayPacket::kRays], t[RayPacket::kRays];
  const auto& a = texture.binding.transform;
  const auto levels = static_cast<uint32_t>(pyramid.levels.size());
  const float size_lod = texture.size_lod;
  ForLanes(lanes, [&](int i, bool meant) {
    s[i] = a[0] * u[i] + a[1] * v[i] + a[2];
    t[i] = a[3] * u[i] + a[4] * v[i] + a[5];
    uint32_t level = 0;
    float share = 0;
    LevelsAt(lod[i] + size_lod, levels, level, share);
    Put(meant, i, level, footprints.level);
    Put(meant, i, share, footprints.share);
  });
  for (uint32_t k = 0; k < 2; ++k) {
    uint64_t with = 0;
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      const bool there = (lanes >> i & 1) != 0 && (k == 0 || footprints.share[i] > 0);
      const TexturePyramid::Level& level = pyramid.levels[there ? footprints.level[i] + k : 0];
      footprints.texels[k].width[i] = level.width;
      footprints.texels[k].height[i] = level.height;
      with |= uint64_t{there} << i;
    }
    FootprintPacket::Texels& texels = footprints.texels[k];
    TexelsAlongLanes(texture.binding.wrap_s, s, texels.width, with, texels.x, texels.fx);
    TexelsAlongLanes(texture.binding.wrap_t, t, texels.height, with, texels.y, texels.fy);
  }
}

void PlaceTexels(const TexturePyramid& pyramid, const FootprintPacket& footprints, uint64_t lanes,
                 TexelPacket& texels) {
  alignas(64) uint32_t columns[RayPacket::kRays], first_page[RayPacket::kRays], offset[RayPacket::kRays];
  for (uint32_t k = 0; k < 2; ++k) {
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      const bool there = (lanes >> i & 1) != 0 && (k == 0 || footprints.share[i] > 0);
      const TexturePyramid::Level& level = pyramid.levels[there ? footprints.level[i] + k : 0];
      columns[i] = level.columns;
      first_page[i] = level.first_page;
      offset[i] = level.tail_offset;
    }
    const FootprintPacket::Texels& t = footprints.texels[k];
    for (uint32_t n = 0; n < 4; ++n) {
      const uint32_t(&xs)[RayPacket::kRays] = t.x[n & 1], (&ys)[RayPacket::kRays] = t.y[n >> 1];
      uint32_t(&page)[RayPacket::kRays] = texels.page[4 * k + n],
      (&index)[RayPacket::kRays] = texels.index[4 * k + n];
      ForLanes(lanes, [&](int i, bool) {
        const uint32_t x = xs[i], y = ys[i], column = x / kPageSide, row = y / kPageSide;
        const uint32_t rest = t.width[i] - column * kPageSide, width = rest < kPageSide ? rest : kPageSide;
        const bool tail = columns[i] == 0;
        page[i] = first_page[i] + (tail ? 0 : row * columns[i] + column);
        index[i] = tail ? offset[i] + y * t.width[i] + x : y % kPageSide * width + x % kPageSide;
      });
    }
  }
}

void SumTexels(const TexturePyramid& pyramid, const FootprintPacket& footprints, const TexelPacket& texels,
               LookupKind kind, uint64_t lanes, TextureLookups& lookups) {
  const TexelLayout layout = pyramid.layout;
  const float* const colors =
      layout.format == TexelFormat::kSrgb8 ? TexelCodes::Get().srgb : TexelCodes::Get().linear;
  switch (kind == LookupKind::kSlope ? 0 : layout.channels) {
    case 0:
      return SumTexels<0>(colors, footprints, texels, lanes, lookups.sum);
    case 1:
      return SumTexels<1>(colors, footprints, texels, lanes, lookups.sum);
    case 2:
      return SumTexels<2>(colors, footprints, texels, lanes, lookups.sum);
    case 3:
      return SumTexels<3>(colors, footprints, texels, lanes, lookups.sum);
    default:
      return SumTexels<4>(colors, footprints, texels, lanes, lookups.sum);
  }
}

void BeginTextureFrames(const TrianglePacket& triangles, const RayPacket& rays, uint64_t lanes,
                        TextureLookups& lookups) {
  ForLanes(lanes, [&](int i, bool meant) {
    const glm::vec3 first = triangles.at[0][i];
    Put(meant, i, triangles.at[1][i] - first, lookups.by_u);
    Put(meant, i, triangles.at[2][i] - first, lookups.by_v);
    Put(meant, i, std::fabs(lookups.cone_width[i] + lookups.cone_spread[i] * rays.hit_t[i]),
        lookups.cone_width);
    Put(meant, i, 0.0f, lookups.bending);
  });
}

void MakeTextureFrames(const AttributePacket& attributes, const SurfacePacket& surfaces, uint64_t lanes,
                       TextureLookups& lookups) {
  ForLanes(lanes, [&](int i, bool meant) {
    const glm::vec3 e1 = lookups.by_u[i], e2 = lookups.by_v[i];
    const glm::vec2 uv0{attributes.u[0][i], attributes.v[0][i]};
    const TextureFrame frame = FrameOf(e1, e2, glm::vec2{attributes.u[1][i], attributes.v[1][i]} - uv0,
                                       glm::vec2{attributes.u[2][i], attributes.v[2][i]} - uv0);
    const float bending =
        BendingOf(e1, e2, attributes.normal[0][i], attributes.normal[1][i], attributes.normal[2][i]);
    const float cosine = std::fabs(glm::dot(surfaces.geometric_normal[i], surfaces.view[i]));
    Put(meant, i, LodOf(frame.uv_area, lookups.cone_width[i], cosine), lookups.lod);
    Put(meant, i, bending, lookups.bending);
    Put(meant, i, frame.by_u, lookups.by_u);
    Put(meant, i, frame.by_v, lookups.by_v);
  });
}

void MapNormals(const SurfaceTexture& texture, const TexturePyramid& pyramid, const TextureLookups& lookups,
                uint64_t lanes, SurfacePacket& surfaces) {
  const TextureBinding binding = texture.binding;
  const auto width = static_cast<float>(pyramid.layout.width),
             height = static_cast<float>(pyramid.layout.height);
  const auto map = [&](auto relief_of) {
    ForLanes(lanes, [&](int i, bool meant) {
      glm::vec3 right, up;
      ImageAxes(binding, lookups.by_u[i], lookups.by_v[i], right, up);
      const glm::vec4 sum{lookups.sum[0][i], lookups.sum[1][i], lookups.sum[2][i], 0};
      Put(meant, i, MappedNormal(relief_of(sum), right, up, surfaces[i]), surfaces.normal);
    });
  };
  const float strength = binding.factor.x;
  if (binding.use == TextureUse::kBump)
    return map([=](const glm::vec4& sum) { return ReliefOfSlope(sum, strength, width, height); });
  map([=](const glm::vec4& sum) { return ReliefOfNormal(sum, strength); });
}

}  // namespace quarry
