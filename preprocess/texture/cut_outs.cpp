#include "preprocess/texture/cut_outs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "preprocess/texture/image_reader.h"
#include "preprocess/texture/row_converter.h"

namespace quarry {
namespace {

/// The parts of a coordinate's magnitude that float arithmetic on the way to a texel may lose: 32 roundings.
constexpr double kRounding = 0x1p-19;
constexpr double kLeastSlack = 1.0 / 256;  // texels

/// An image and the rules by which its texels are judged, with the materials that use each.
struct Wanted {
  uint32_t image;
  std::map<OpacityRule, std::vector<uint32_t>> rules;
};

std::vector<Wanted> WantedBy(const std::vector<Material>& materials) {
  std::map<uint32_t, Wanted> wanted;
  for (uint32_t m = 0; m < materials.size(); ++m)
    for (const TextureBinding& b : materials[m].textures) {
      if (b.use != TextureUse::kOpacity) continue;
      Wanted& w = wanted[b.texture];
      w.image = b.texture;
      w.rules[{b.factor.w, b.cutoff}].push_back(m);
    }
  std::vector<Wanted> images;
  for (auto& [image, w] : wanted) images.push_back(std::move(w));
  return images;
}

/// Leaves out the images whose headers show no alpha. A colour may have one, most have none: an image is not
/// decoded to find that out. Errors: no image can be read.
Status LeaveOutOpaque(std::vector<Wanted>& wanted, const std::vector<TextureImage>& images,
                      const ImageDecoding& decoding) {
  ImageDecoder decoder(decoding);
  std::vector<Wanted> left;
  for (Wanted& w : wanted) {
    const TextureImage& image = images[w.image];
    if (image.pick == TexturePick::kColorAndAlpha) {
      const Result<ImageFacts> facts = decoder.LookAt(image);
      if (!facts && decoder.is_fatal()) return tl::unexpected<Error>(facts.error());
      if (!facts || !HasOpacity(RowConverter(*facts, image.color, image.pick).layout(), image.pick)) continue;
    }
    left.push_back(std::move(w));
  }
  wanted = std::move(left);
  return {};
}

/// Reads an image's rows into a map for each rule. Empty: it cannot be read, or has no opacity.
Result<std::vector<OpacityMap>> ReadMaps(const TextureImage& image, const Wanted& wanted, ImageReader& reader,
                                         OpacityTiles& tiles) {
  std::vector<OpacityMap> maps;
  std::optional<RowConverter> converter;
  for (;;) {
    const ImageReader::Piece piece = reader.Next();
    if (piece.kind == ImageReader::Piece::Kind::kEnd) {
      if (piece.fatal) return tl::unexpected<Error>(piece.status.error());
      if (!piece.status) maps.clear();
      return maps;
    }
    if (piece.kind == ImageReader::Piece::Kind::kFacts) {
      converter.emplace(piece.facts, image.color, image.pick);
      if (HasOpacity(converter->layout(), image.pick))
        for (const auto& [rule, materials] : wanted.rules) maps.emplace_back(converter->layout(), rule);
      continue;
    }
    const size_t row = converter->row_bytes();
    for (size_t at = 0; at < piece.rows.size() && !maps.empty(); at += row) {
      const std::span<const std::byte> texels = converter->Convert(std::span(piece.rows).subspan(at, row));
      for (OpacityMap& map : maps) QUARRY_TRY(map.AddRow(texels, tiles));
    }
  }
}

double Finite(float value, float other) { return std::isfinite(value) && std::isfinite(other) ? value : 0; }

/// The corners of a sub-triangle: barycentric weights of the second and third vertex, in quarters.
std::array<std::array<int, 2>, 3> CornersOf(uint32_t sub) {
  int row = 0, place = static_cast<int>(sub);
  for (; place >= 7 - 2 * row; ++row) place -= 7 - 2 * row;
  const int column = place / 2;
  if (place % 2 == 0) return {{{column, row}, {column + 1, row}, {column, row + 1}}};
  return {{{column + 1, row}, {column + 1, row + 1}, {column, row + 1}}};
}

TexelTriangle SubTriangle(const TexelTriangle& whole, uint32_t sub) {
  TexelTriangle part = whole;
  const auto corners = CornersOf(sub);
  for (size_t k = 0; k < 3; ++k) {
    const double b1 = corners[k][0] / 4.0, b2 = corners[k][1] / 4.0;
    for (size_t a = 0; a < 2; ++a)
      part.corners[k][a] =
          (1 - b1 - b2) * whole.corners[0][a] + b1 * whole.corners[1][a] + b2 * whole.corners[2][a];
  }
  return part;
}

}  // namespace

Result<CutOuts> CutOuts::Read(const std::vector<Material>& materials, const std::vector<TextureImage>& images,
                              const ImageDecoding& decoding, const std::string& path, Progress& progress) {
  CutOuts cut_outs;
  std::vector<Wanted> wanted = WantedBy(materials);
  QUARRY_TRY(LeaveOutOpaque(wanted, images, decoding));
  if (wanted.empty()) return cut_outs;
  QUARRY_ASSIGN(cut_outs.tiles_, OpacityTiles::Create(path));
  cut_outs.uses_.resize(materials.size());
  std::vector<TextureImage> list;
  for (const Wanted& w : wanted) list.push_back(images[w.image]);
  progress.Begin(fmt::format("reading the opacity of {} images", list.size()));
  ImageReader reader(list, 0, decoding);
  for (size_t i = 0; i < list.size(); ++i) {
    QUARRY_ASSIGN(std::vector<OpacityMap> maps, ReadMaps(list[i], wanted[i], reader, *cut_outs.tiles_));
    auto rule = wanted[i].rules.begin();
    for (OpacityMap& map : maps) {
      for (const uint32_t m : rule->second) {
        cut_outs.uses_[m].map = static_cast<uint32_t>(cut_outs.maps_.size());
        cut_outs.uses_[m].binding =
            *std::ranges::find(materials[m].textures, TextureUse::kOpacity, &TextureBinding::use);
      }
      cut_outs.maps_.push_back(std::move(map));
      ++rule;
    }
    progress.Update(i + 1, list.size());
  }
  progress.End();
  QUARRY_TRY(cut_outs.tiles_->EndWriting());
  return cut_outs;
}

/// The triangle in its material's image.
TexelTriangle CutOuts::Place(const TriangleRecord& triangle) const {
  const Use& use = uses_[triangle.material];
  const OpacityMap& map = maps_[use.map];
  const double sizes[] = {static_cast<double>(map.width()), static_cast<double>(map.height())};
  TexelTriangle place;
  for (size_t a = 0; a < 2; ++a) {
    const float* row = &use.binding.transform[3 * a];
    double largest = 0;
    for (size_t k = 0; k < 3; ++k) {
      // Shading takes (0, 0) for coordinates that are not finite.
      const glm::vec2& uv = triangle.uvs[k];
      const double u = Finite(uv.x, uv.y), v = Finite(uv.y, uv.x);
      place.corners[k][a] = (row[0] * u + row[1] * v + row[2]) * sizes[a];
      largest = std::max(largest, std::fabs(row[0] * u) + std::fabs(row[1] * v) + std::fabs(double{row[2]}));
    }
    place.slack[a] = largest * sizes[a] * kRounding + kLeastSlack;
  }
  return place;
}

TexelStates CutOuts::StatesOf(const TexelTriangle& place, uint32_t material) const {
  const Use& use = uses_[material];
  return StatesAbout(place, maps_[use.map], *tiles_, use.binding.wrap_s, use.binding.wrap_t);
}

uint32_t CutOuts::MaskOf(const TriangleRecord& triangle) const {
  if (!IsMapped(triangle.material)) return kOpaqueMask;
  const TexelTriangle place = Place(triangle);
  const TexelStates all = StatesOf(place, triangle.material);
  if (all.opaque) return kOpaqueMask;
  if (all.transparent) return kTransparentMask;
  uint32_t mask = 0;
  for (uint32_t sub = 0; sub < kSubTriangles; ++sub) {
    const TexelStates states = StatesOf(SubTriangle(place, sub), triangle.material);
    const OpacityState state = states.opaque        ? OpacityState::kOpaque
                               : states.transparent ? OpacityState::kTransparent
                                                    : OpacityState::kMixed;
    mask |= static_cast<uint32_t>(state) << (2 * sub);
  }
  return mask;
}

bool CutOuts::IsTransparent(const TriangleRecord& triangle) const {
  return IsMapped(triangle.material) && StatesOf(Place(triangle), triangle.material).transparent;
}

}  // namespace quarry
