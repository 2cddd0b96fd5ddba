#include "preprocess/texture/cut_outs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "preprocess/texture/image_reader.h"
#include "preprocess/texture/row_converter.h"

namespace quarry {
namespace {

/// The parts of a coordinate's magnitude that float arithmetic on the way to a texel may lose: 32 roundings.
constexpr double kRounding = 0x1p-19;
constexpr double kLeastSlack = 1.0 / 256;  // texels
/// Images from the first: half as far as lookups tell places apart (TexelsAlong).
constexpr double kMostImages = 0x1p19;

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

/// Texels after which an image's texels come again along an axis; 0: they do not.
double PeriodOf(TextureWrap wrap, double size) {
  return wrap == TextureWrap::kClamp ? 0 : wrap == TextureWrap::kMirror ? 2 * size : size;
}

/// Sets axis `a` of a place. `slack` in texels. The slack grows by what the grid moves corners; a triangle
/// too far or too large for the grid covers all of the image.
void PutOnGrid(const double (&corners)[3], double slack, double period, size_t a, MaskPlace& place) {
  constexpr double kMost = 1 << 24;  // texels
  const double least = *std::ranges::min_element(corners);
  const double shift = period > 0 ? std::floor(least / period) * period : 0;
  const auto beyond = [&](double corner) { return !(std::fabs(corner - shift) <= kMost); };
  if (std::ranges::any_of(corners, beyond) || !(slack <= kMost)) {
    place.slack[0] = place.slack[1] = std::numeric_limits<uint32_t>::max();
    return;
  }
  for (size_t k = 0; k < 3; ++k)
    place.corners[k][a] = static_cast<int32_t>(std::lround((corners[k] - shift) * MaskPlace::kGrid));
  const auto on_grid = static_cast<uint32_t>(std::ceil(slack * MaskPlace::kGrid + 0.5));
  place.slack[a] = std::max(place.slack[a], on_grid);
}

TexelTriangle InTexels(const MaskPlace& place) {
  TexelTriangle triangle;
  for (size_t a = 0; a < 2; ++a) {
    for (size_t k = 0; k < 3; ++k) triangle.corners[k][a] = place.corners[k][a] / MaskPlace::kGrid;
    triangle.slack[a] = place.slack[a] / MaskPlace::kGrid;
  }
  return triangle;
}

/// The corners of a sub-triangle: weights of the second and third vertex, in parts of an edge.
using Corners = std::array<std::array<int, 2>, 3>;

Corners CornersOf(uint32_t sub, int steps) {
  int row = 0, place = static_cast<int>(sub);
  for (; place >= 2 * (steps - row) - 1; ++row) place -= 2 * (steps - row) - 1;
  const int column = place / 2;
  if (place % 2 == 0) return {{{column, row}, {column + 1, row}, {column, row + 1}}};
  return {{{column + 1, row}, {column + 1, row + 1}, {column, row + 1}}};
}

TexelTriangle SubTriangle(const TexelTriangle& whole, const Corners& corners, int steps) {
  TexelTriangle part = whole;
  for (size_t k = 0; k < 3; ++k) {
    const double b1 = corners[k][0] / double(steps), b2 = corners[k][1] / double(steps);
    for (size_t a = 0; a < 2; ++a)
      part.corners[k][a] =
          (1 - b1 - b2) * whole.corners[0][a] + b1 * whole.corners[1][a] + b2 * whole.corners[2][a];
  }
  return part;
}

/// The coarse sub-triangle that has a fine one with these corners.
uint32_t CoarseOf(const Corners& corners) {
  constexpr float kParts = 3.0f * kFineMaskSteps;
  const auto middle = [&](size_t a) {
    return static_cast<float>(corners[0][a] + corners[1][a] + corners[2][a]) / kParts;
  };
  return SubTriangleOf<kMaskSteps>(middle(0), middle(1));
}

/// Whether the fine sub-triangles of a triangle may tell more than the coarse ones. They do not where all
/// touch the same texels, nor where each reaches across an image.
bool Refines(const TexelTriangle& whole, const OpacityMap& map) {
  const double sizes[] = {static_cast<double>(map.width()), static_cast<double>(map.height())};
  double largest = 0;
  for (size_t a = 0; a < 2; ++a) {
    const auto [least, most] = std::minmax({whole.corners[0][a], whole.corners[1][a], whole.corners[2][a]});
    if ((most - least) / kFineMaskSteps + 2 * whole.slack[a] >= sizes[a]) return false;
    largest = std::max(largest, most - least);
  }
  return largest > 1;
}

OpacityState StateOf(const TexelStates& states) {
  return states.opaque        ? OpacityState::kOpaque
         : states.transparent ? OpacityState::kTransparent
                              : OpacityState::kMixed;
}

FineMask Throughout(uint32_t coarse) {
  FineMask fine;
  std::ranges::fill(fine.words, coarse);
  return fine;
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

MaskPlace CutOuts::PlaceOf(const TriangleRecord& triangle) const {
  const Use& use = uses_[triangle.material];
  const OpacityMap& map = maps_[use.map];
  const double sizes[] = {static_cast<double>(map.width()), static_cast<double>(map.height())};
  const TextureWrap wraps[] = {use.binding.wrap_s, use.binding.wrap_t};
  MaskPlace place;
  place.material = triangle.material;
  for (size_t a = 0; a < 2; ++a) {
    const float* row = &use.binding.transform[3 * a];
    double corners[3], largest = 0;
    for (size_t k = 0; k < 3; ++k) {
      // Shading takes (0, 0) for coordinates that are not finite.
      const glm::vec2& uv = triangle.uvs[k];
      const double u = Finite(uv.x, uv.y), v = Finite(uv.y, uv.x);
      corners[k] = (row[0] * u + row[1] * v + row[2]) * sizes[a];
      largest = std::max(largest, std::fabs(row[0] * u) + std::fabs(row[1] * v) + std::fabs(double{row[2]}));
    }
    const double slack = largest < kMostImages ? largest * sizes[a] * kRounding + kLeastSlack
                                               : std::numeric_limits<double>::infinity();
    PutOnGrid(corners, slack, PeriodOf(wraps[a], sizes[a]), a, place);
  }
  return place;
}

TexelStates CutOuts::StatesOf(const TexelTriangle& place, uint32_t material) const {
  const Use& use = uses_[material];
  return StatesAbout(place, maps_[use.map], *tiles_, use.binding.wrap_s, use.binding.wrap_t);
}

TriangleMask CutOuts::MaskAt(const MaskPlace& place, bool fine) const {
  const TexelTriangle whole = InTexels(place);
  const TexelStates all = StatesOf(whole, place.material);
  if (all.opaque) return {kOpaqueMask, Throughout(kOpaqueMask)};
  if (all.transparent) return {kTransparentMask, Throughout(kTransparentMask)};
  const auto state_of = [&](const Corners& corners, int steps) {
    return StateOf(StatesOf(SubTriangle(whole, corners, steps), place.material));
  };
  TriangleMask mask{0, {}};
  for (uint32_t sub = 0; sub < kSubTriangles; ++sub)
    mask.coarse |= static_cast<uint32_t>(state_of(CornersOf(sub, kMaskSteps), kMaskSteps)) << (2 * sub);
  if (!fine) return mask;
  const bool refines = Refines(whole, maps_[uses_[place.material].map]);
  for (uint32_t sub = 0; sub < kFineSubTriangles; ++sub) {
    const Corners corners = CornersOf(sub, kFineMaskSteps);
    OpacityState state = StateOf(mask.coarse, CoarseOf(corners));
    if (state == OpacityState::kMixed && refines) state = state_of(corners, kFineMaskSteps);
    mask.fine.words[sub / 16] |= static_cast<uint32_t>(state) << (2 * (sub % 16));
  }
  return mask;
}

bool CutOuts::IsTransparent(const TriangleRecord& triangle) const {
  return IsMapped(triangle.material) && StatesOf(InTexels(PlaceOf(triangle)), triangle.material).transparent;
}

}  // namespace quarry
