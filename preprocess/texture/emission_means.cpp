#include "preprocess/texture/emission_means.h"

#include <algorithm>
#include <cmath>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <utility>

#include "common/base/bytes.h"
#include "common/voxel/texture_page.h"
#include "preprocess/texture/texel_codes.h"

namespace quarry {
namespace {

constexpr int kRows = 8;  // of places in a triangle

/// Where along an axis of `size` texels a position lies, by the texture's wrap.
uint32_t TexelAlong(TextureWrap wrap, double position, uint32_t size) {
  double p = std::isfinite(position) ? position : 0;
  switch (wrap) {
    case TextureWrap::kRepeat:
      p -= std::floor(p);
      break;
    case TextureWrap::kMirror:
      p -= 2 * std::floor(p / 2);
      p = p > 1 ? 2 - p : p;
      break;
    case TextureWrap::kClamp:
      p = std::clamp(p, 0.0, 1.0);
      break;
  }
  return std::min(static_cast<uint32_t>(p * size), size - 1);
}

/// The middles of the small triangles into which kRows rows cut a triangle, as weights of the second and
/// third corner.
template <class Each>
void ForEachPlace(Each&& each) {
  constexpr double kThird = 1.0 / 3;
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kRows - row; ++column) {
      each((column + kThird) / kRows, (row + kThird) / kRows);
      if (row + column + 1 < kRows) each((column + 2 * kThird) / kRows, (row + 2 * kThird) / kRows);
    }
}

/// The radiance of a texel, whose colour ToLinear() has multiplied by alpha. Values below 0 or that are none
/// count as 0, as in shading.
glm::dvec3 RadianceOf(const float* texel, const TexelLayout& layout, const glm::vec4& factor) {
  const uint32_t colors = layout.has_alpha() ? layout.channels - 1 : layout.channels;
  const double alpha = layout.has_alpha() ? static_cast<double>(texel[colors]) : 1;
  if (!(alpha > 0)) return glm::dvec3(0);
  constexpr double kMost = 1e30;
  const auto radiance = [&](uint32_t channel, float times) {
    const double value = static_cast<double>(texel[channel]) / alpha * static_cast<double>(times);
    return value > 0 ? std::min(value, kMost) : 0.0;
  };
  return {radiance(0, factor.x), radiance(colors < 3 ? 0 : 1, factor.y),
          radiance(colors < 3 ? 0 : 2, factor.z)};
}

}  // namespace

Result<const std::vector<float>*> EmissionMeans::PageAt(uint32_t texture, uint32_t page) {
  const std::pair key{texture, page};
  if (const auto known = pages_.find(key); known != pages_.end()) return &known->second;
  const WrittenTexture& written = textures_[texture];
  const BlockEntry& entry = written.texture.pages[page];
  Bytes stored(entry.stored);
  QUARRY_TRY(file_.ReadAt(entry.offset, stored));
  if (Checksum(stored) != entry.checksum) return Fail("a page of a texture has changed since it was written");
  QUARRY_ASSIGN(const Bytes texels, DecodePage(shapes_.at(texture), written.texture.layout, page, stored));
  TexelLayout row = written.texture.layout;  // ToLinear() takes a row
  row.width = static_cast<uint32_t>(texels.size() / row.texel_bytes());
  if (pages_.size() == kMostPages) pages_.clear();
  std::vector<float>& linear = pages_[key];
  ToLinear(texels, row, linear);
  return &linear;
}

Result<glm::vec3> EmissionMeans::Of(const Emitter& emitter, const TextureBinding& map) {
  const TexelLayout& layout = textures_[map.texture].texture.layout;
  const TextureShape& shape = shapes_.try_emplace(map.texture, layout.width, layout.height).first->second;
  glm::dvec2 corners[3];
  for (int i = 0; i < 3; ++i) {
    const glm::dvec2 uv(emitter.uvs[i]);
    const auto& t = map.transform;
    corners[i] = {t[0] * uv.x + t[1] * uv.y + t[2], t[3] * uv.x + t[4] * uv.y + t[5]};
  }
  double longest = 0;  // in texels
  for (int i = 0; i < 3; ++i) {
    const glm::dvec2 edge = corners[(i + 1) % 3] - corners[i];
    longest = std::max({longest, std::fabs(edge.x) * layout.width, std::fabs(edge.y) * layout.height});
  }
  uint32_t number = 0;
  for (; longest > kRows && number + 1 < shape.levels().size(); longest /= 2) ++number;
  const TextureShape::Level& level = shape.levels()[number];
  const bool in_tail = number >= shape.tail();

  glm::dvec3 sum(0);
  double places = 0;
  Status status;
  ForEachPlace([&](double b1, double b2) {
    if (!status) return;
    const glm::dvec2 at = corners[0] * (1 - b1 - b2) + corners[1] * b1 + corners[2] * b2;
    const uint32_t x = TexelAlong(map.wrap_s, at.x, level.width),
                   y = TexelAlong(map.wrap_t, at.y, level.height);
    const uint32_t column = in_tail ? 0 : x / kPageSide, row = in_tail ? 0 : y / kPageSide;
    const uint32_t width = in_tail ? level.width : std::min(kPageSide, level.width - column * kPageSide);
    const uint32_t index =
        (in_tail ? shape.TailOffset(number) : 0) + (y - row * kPageSide) * width + (x - column * kPageSide);
    const auto page = PageAt(map.texture, shape.PageOf(number, column, row));
    if (!page) {
      status = tl::unexpected<Error>(page.error());
      return;
    }
    sum += RadianceOf(&(**page)[size_t{index} * layout.channels], layout, map.factor);
    places += 1;
  });
  QUARRY_TRY(status);
  return glm::vec3(sum / places);
}

Status GiveEmitters(std::vector<Emitter> emitters, const std::vector<Material>& materials,
                    const std::string& path, StoreWriter& writer) {
  if (emitters.empty()) return {};
  QUARRY_TRY(writer.Flush());
  QUARRY_ASSIGN(const InputFile file, InputFile::Open(path));
  EmissionMeans means(writer.textures(), file);
  for (Emitter& emitter : emitters) {
    const Material& material = materials[emitter.material];
    emitter.radiance = material.emission;
    if (const TextureBinding* map = EmissionMapOf(material)) {
      QUARRY_ASSIGN(emitter.radiance, means.Of(emitter, *map));
    } else {
      std::ranges::fill(emitter.uvs, glm::vec2(0));
    }
  }
  std::erase_if(emitters, [&](const Emitter& emitter) {
    return emitter.radiance == glm::vec3(0) || !Shines(materials[emitter.material]);
  });
  writer.SetEmitters(std::move(emitters));
  return {};
}

}  // namespace quarry
