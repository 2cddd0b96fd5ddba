#include "tests/laboratory/machine/study.h"

#include <numeric>

namespace quarry::laboratory {

uint64_t CountedRun::all_bytes() const { return std::accumulate(bytes.begin(), bytes.end(), uint64_t{0}); }
uint64_t CountedRun::all_cached_bytes() const {
  return std::accumulate(cached_bytes.begin(), cached_bytes.end(), uint64_t{0});
}

namespace {

/// How often a kernel's body ran: as often as the kernel, or once a step where a pass takes several.
uint64_t BodiesOf(const MachineCounts& counts, KernelId kernel) {
  if (kernel == KernelId::kTraverse) return counts.steps;
  if (kernel == KernelId::kIntersect) return counts.tests;
  return counts.runs[static_cast<uint32_t>(kernel)];
}

}  // namespace

CountedRun CountsOf(const CountingMemory& memory, const TextureCache& cache, const MachineCounts& counts,
                    bool multipass) {
  CountedRun run;
  run.counts = counts;
  for (uint32_t k = 0; k < kKernels; ++k) run.words[k] = memory.OfKernel(k);
  for (uint32_t k = 0; k < kDataKinds; ++k) {
    const auto kind = static_cast<DataKind>(k);
    const MemoryWords words = memory.OfKind(kind);
    run.bytes[k] = 4 * (words.read + words.written + words.fetched);
    run.cached_bytes[k] = 4 * words.written + cache.fetched_bytes(kind);
  }
  // Each pass reads the stencil of all rays, before the kernel runs, and past the cache.
  const uint64_t stencil = multipass ? counts.places + memory.Stencil().written : 0;
  run.bytes[static_cast<uint32_t>(DataKind::kStencil)] = stencil;
  run.cached_bytes[static_cast<uint32_t>(DataKind::kStencil)] = stencil;
  const CacheTotals& vertices = cache.totals(DataKind::kTriangles);
  run.triangle_accesses = vertices.hits + vertices.misses;
  run.triangle_hits = vertices.hits;
  return run;
}

double PredictedInstructions(const Instructions& instructions, const MachineCounts& counts, bool branching) {
  double sum = 0;
  for (uint32_t k = 0; k < kKernels; ++k) {
    sum += instructions[k].body * static_cast<double>(BodiesOf(counts, static_cast<KernelId>(k)));
    sum += (branching ? instructions[k].leave : instructions[k].form) * static_cast<double>(counts.runs[k]);
  }
  return sum;
}

double PredictedWords(const CountedRun& measured, const MachineCounts& counts) {
  double sum = 0;
  for (uint32_t k = 0; k < kKernels; ++k) {
    if (measured.counts.runs[k] == 0) continue;
    const MemoryWords& words = measured.words[k];
    sum += static_cast<double>(words.read + words.written + words.fetched) /
           static_cast<double>(measured.counts.runs[k]) * static_cast<double>(counts.runs[k]);
  }
  return sum;
}

}  // namespace quarry::laboratory
