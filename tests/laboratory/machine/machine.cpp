#include "tests/laboratory/machine/machine.h"

#include <numeric>

namespace quarry::laboratory {

uint64_t MachineCounts::all_passes() const { return std::accumulate(passes, passes + kKernels, uint64_t{0}); }

uint64_t MachineCounts::structure_passes() const {
  return passes[static_cast<uint32_t>(KernelId::kTraverse)] + passes[static_cast<uint32_t>(KernelId::kUp)] +
         passes[static_cast<uint32_t>(KernelId::kIntersect)];
}

double MachineCounts::simd_efficiency() const {
  const uint64_t working = std::accumulate(runs, runs + kKernels, uint64_t{0});
  return places == 0 ? 0 : static_cast<double>(working) / static_cast<double>(places);
}

}  // namespace quarry::laboratory
