#include "common/scene/tile.h"

namespace quarry {

uint32_t SumWords(uint32_t aov_mask) {
  uint32_t words = kColorWords;
  for (const Aov aov : kAveraged)
    if (aov_mask >> static_cast<int>(aov) & 1)
      words += static_cast<uint32_t>(kAovInfo[static_cast<int>(aov)].words);
  return words;
}

size_t BytesPerPoint(PixelForm form, uint32_t aov_mask) {
  const size_t words = WordsPerPixel(aov_mask);
  if (form == PixelForm::kShown) return sizeof(uint32_t);
  return form == PixelForm::kSums ? SumWords(aov_mask) * sizeof(int64_t) + 4 * (words - kColorWords)
                                  : 4 * words;
}

Status CheckTile(const Tile& tile, const View& view) {
  const PixelRect& p = tile.pixels;
  const auto lies = [](uint32_t from, uint32_t length, uint32_t in_from, uint32_t in_length) {
    return length > 0 && from >= in_from && length <= in_length && from - in_from <= in_length - length;
  };
  const auto is_phase = [&](uint32_t phase) { return phase == Tile::kMiddle || phase < tile.step; };
  if (tile.step == 0 || tile.step > kMaxImageSide || !is_phase(tile.phase_x) || !is_phase(tile.phase_y) ||
      !lies(p.x, p.width, view.crop.x, view.crop.width) ||
      !lies(p.y, p.height, view.crop.y, view.crop.height))
    return Fail("a tile does not lie in its view");
  const size_t points = size_t{tile.columns()} * tile.rows();
  if (points == 0 || tile.columns() > kMaxTilePoints || tile.rows() > kMaxTilePoints ||
      points * BytesPerPoint(tile.form, view.aov_mask) > kMaxTileBytes)
    return Fail("a tile is empty or too large");
  const bool all = tile.samples == 0 && tile.first_sample == 0;
  if (!all && (tile.samples == 0 || tile.samples > view.spp || tile.first_sample > view.spp - tile.samples ||
               tile.form == PixelForm::kMeans))
    return Fail("a tile asks for samples that its view does not have");
  if (tile.leaves_holes && (tile.form != PixelForm::kShown || tile.samples_of(view.spp) != 1))
    return Fail("a tile leaves holes where no hole is possible");
  return {};
}

}  // namespace quarry
