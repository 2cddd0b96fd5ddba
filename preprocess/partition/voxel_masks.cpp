#include "preprocess/partition/voxel_masks.h"

#include <algorithm>
#include <bit>
#include <functional>

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

/// A fine mask, and what it decides beyond the coarse masks of its triangles together.
struct Wanted {
  uint16_t fine;
  uint64_t gain;
};

}  // namespace

VoxelMasks FindMasks(std::span<const TriangleRecord> triangles, const TriangleMasks& masks, size_t most) {
  constexpr uint16_t kNone = 0xFFFF;
  Interner<MaskPlace> place_numbers(triangles.size());
  Interner<FineMask> fine_numbers(triangles.size());
  std::vector<MaskPlace> places;
  std::vector<FineMask> fine;
  std::vector<uint32_t> coarse;             // of each place
  std::vector<uint16_t> fine_of, place_of;  // of each place, its fine mask; of each triangle, its place
  std::vector<Wanted> wanted;               // of each fine mask
  place_of.reserve(triangles.size());
  for (const TriangleRecord& t : triangles) {
    if (!masks.is_mapped(t.material)) {
      place_of.push_back(kNone);
      continue;
    }
    const uint16_t number = place_numbers.Index(masks.place_of(t), places);
    place_of.push_back(number);
    if (number == coarse.size()) {
      const TriangleMask mask = masks.mask_at(places.back());
      coarse.push_back(mask.coarse);
      fine_of.push_back(GainOf(mask) >= kLeastGain ? fine_numbers.Index(mask.fine, fine) : kNone);
      if (fine.size() > wanted.size()) wanted.push_back({fine_of.back(), 0});
    }
    if (const uint16_t of = fine_of[number]; of != kNone)
      wanted[of].gain += GainOf({coarse[number], fine[of]});
  }
  if (wanted.size() > most) {
    std::ranges::stable_sort(wanted, std::greater<>(), &Wanted::gain);
    wanted.resize(most);
    std::ranges::sort(wanted, std::less<>(), &Wanted::fine);
  }
  VoxelMasks found;
  std::vector<uint32_t> names(fine.size(), 0);
  for (const Wanted& w : wanted) {
    names[w.fine] = NameFineMask(static_cast<uint32_t>(found.fine.size()));
    found.fine.push_back(fine[w.fine]);
  }
  found.masks.reserve(triangles.size());
  for (const uint16_t place : place_of) {
    const uint32_t name = place != kNone && fine_of[place] != kNone ? names[fine_of[place]] : 0;
    found.masks.push_back(name != 0 ? name : place != kNone ? coarse[place] : kOpaqueMask);
  }
  return found;
}

}  // namespace quarry
