#include "preprocess/partition/voxel_masks.h"

#include <algorithm>
#include <bit>
#include <functional>
#include <numeric>

#include "preprocess/partition/interner.h"

namespace quarry {
namespace {

/// Fine sub-triangles that the fine mask of a triangle must decide beyond the coarse one: a coarse one's.
constexpr uint32_t kLeastGain = kFineSubTriangles / kSubTriangles;

/// States of a word that are not mixed.
uint32_t Decided(uint32_t states) { return static_cast<uint32_t>(std::popcount(states)); }

/// Fine sub-triangles that a triangle's fine mask decides beyond its coarse one.
uint32_t GainOf(const TriangleMask& mask) {
  uint32_t fine = 0;
  for (const uint32_t word : mask.fine.words) fine += Decided(word);
  return fine - kFineSubTriangles / kSubTriangles * Decided(mask.coarse);
}

}  // namespace

VoxelMasks FindMasks(std::span<const TriangleRecord> triangles, const TriangleMasks& masks, size_t most) {
  constexpr uint16_t kNone = 0xFFFF;
  Interner<MaskPlace> place_numbers(triangles.size());
  std::vector<MaskPlace> places;
  std::vector<uint32_t> words, open;  // of each place: its mask, and the open sub-triangles of its triangles
  std::vector<uint16_t> place_of;     // of each triangle
  place_of.reserve(triangles.size());
  for (const TriangleRecord& t : triangles) {
    const bool mapped = masks.is_mapped(t.material);
    const uint16_t place = mapped ? place_numbers.Index(masks.place_of(t), places) : kNone;
    place_of.push_back(place);
    if (!mapped) continue;
    if (place == words.size()) {
      words.push_back(masks.mask_at(places.back(), false).coarse);
      open.push_back(0);
    }
    open[place] += kSubTriangles - Decided(words[place]);
  }
  std::vector<uint16_t> refined(places.size());
  std::iota(refined.begin(), refined.end(), uint16_t{0});
  std::erase_if(refined, [&](uint16_t place) { return open[place] == 0; });
  std::ranges::stable_sort(refined, std::greater<>(), [&](uint16_t place) { return open[place]; });
  refined.resize(std::min(refined.size(), most));
  std::ranges::sort(refined);
  VoxelMasks found;
  Interner<FineMask> fine_numbers(refined.size());
  for (const uint16_t place : refined) {
    const TriangleMask mask = masks.mask_at(places[place], true);
    if (GainOf(mask) >= kLeastGain) words[place] = NameFineMask(fine_numbers.Index(mask.fine, found.fine));
  }
  found.masks.reserve(triangles.size());
  for (const uint16_t place : place_of) found.masks.push_back(place != kNone ? words[place] : kOpaqueMask);
  return found;
}

}  // namespace quarry
