#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/laboratory/tables/papers_scene.h"

// Table 3 of Foley & Sugerman 2005: each kernel alone.

namespace quarry::laboratory {

/// A kernel over the states that the rays of a frame bring to it, as a machine of streams runs it: one call
/// reads its ray's stream elements and textures, and writes its stream elements.
struct KernelCost {
  std::string name;
  uint64_t calls = 0;          ///< recorded and timed, a sample of the frame's
  double words_in = 0;         ///< a call: streams and textures
  double words_out = 0;        ///< a call
  double fetches = 0;          ///< places of textures read a call, each at an address that data gives
  double nanoseconds = 0;      ///< a call, scalar, one core, the median of repetitions
  double gigabytes_per_s = 0;  ///< words in and out times calls, over the time
};

/// Costs of brute force's intersect, the grid's and the tree's kernels. The grid and the tree intersect by
/// the same kernel. `most_calls`: about so many of each kernel at most, of rays from all of the frame.
std::vector<KernelCost> MeasureKernels(const PapersScene& scene, int repetitions, size_t most_calls);

}  // namespace quarry::laboratory
