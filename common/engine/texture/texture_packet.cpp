#include "common/engine/texture/texture_packet.h"

#include "common/engine/shading/for_lanes.h"
#include "common/engine/texture/texture_frame.h"

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

}  // namespace

void MakeFootprints(const SurfaceTexture& texture, const TexturePyramid& pyramid,
                    const float (&u)[RayPacket::kRays], const float (&v)[RayPacket::kRays],
                    const float (&lod)[RayPacket::kRays], uint64_t lanes, FootprintPacket& footprints) {
  alignas(64) float s[RayPacket::kRays], t[RayPacket::kRays];
  alignas(64) uint32_t width[RayPacket::kRays], height[RayPacket::kRays];
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
      width[i] = level.width;
      height[i] = level.height;
      with |= uint64_t{there} << i;
    }
    FootprintPacket::Texels& texels = footprints.texels[k];
    TexelsAlongLanes(texture.binding.wrap_s, s, width, with, texels.x, texels.fx);
    TexelsAlongLanes(texture.binding.wrap_t, t, height, with, texels.y, texels.fy);
  }
}

void StartLooks(const TrianglePacket& triangles, const RayPacket& rays, uint64_t lanes, LookPacket& looks) {
  ForLanes(lanes, [&](int i, bool meant) {
    const glm::vec3 first = triangles.at[0][i];
    Put(meant, i, triangles.at[1][i] - first, looks.by_u);
    Put(meant, i, triangles.at[2][i] - first, looks.by_v);
    Put(meant, i, std::fabs(looks.cone_width[i] + looks.cone_spread[i] * rays.hit_t[i]), looks.cone_width);
    Put(meant, i, 0.0f, looks.bending);
  });
}

void FrameLooks(const AttributePacket& attributes, const SurfacePacket& surfaces, uint64_t lanes,
                LookPacket& looks) {
  ForLanes(lanes, [&](int i, bool meant) {
    const glm::vec3 e1 = looks.by_u[i], e2 = looks.by_v[i];
    const glm::vec2 uv0{attributes.u[0][i], attributes.v[0][i]};
    const TextureFrame frame = FrameOf(e1, e2, glm::vec2{attributes.u[1][i], attributes.v[1][i]} - uv0,
                                       glm::vec2{attributes.u[2][i], attributes.v[2][i]} - uv0);
    const float bending =
        BendingOf(e1, e2, attributes.normal[0][i], attributes.normal[1][i], attributes.normal[2][i]);
    const float cosine = std::fabs(glm::dot(surfaces.geometric_normal[i], surfaces.view[i]));
    Put(meant, i, LodOf(frame.uv_area, looks.cone_width[i], cosine), looks.lod);
    Put(meant, i, bending, looks.bending);
    Put(meant, i, frame.by_u, looks.by_u);
    Put(meant, i, frame.by_v, looks.by_v);
  });
}

void MapNormals(const SurfaceTexture& texture, const TexturePyramid& pyramid, const LookPacket& looks,
                uint64_t lanes, SurfacePacket& surfaces) {
  const TextureBinding binding = texture.binding;
  const auto width = static_cast<float>(pyramid.layout.width),
             height = static_cast<float>(pyramid.layout.height);
  const auto map = [&](auto relief_of) {
    ForLanes(lanes, [&](int i, bool meant) {
      glm::vec3 right, up;
      ImageAxes(binding, looks.by_u[i], looks.by_v[i], right, up);
      const glm::vec4 sum{looks.sum[0][i], looks.sum[1][i], looks.sum[2][i], 0};
      Put(meant, i, MappedNormal(relief_of(sum), right, up, surfaces[i]), surfaces.normal);
    });
  };
  const float strength = binding.factor.x;
  if (binding.use == TextureUse::kBump)
    return map([=](const glm::vec4& sum) { return ReliefOfSlope(sum, strength, width, height); });
  map([=](const glm::vec4& sum) { return ReliefOfNormal(sum, strength); });
}

}  // namespace quarry
