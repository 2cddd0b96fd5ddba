#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tests/laboratory/machine/counting_memory.h"
#include "tests/laboratory/machine/machine.h"
#include "tests/laboratory/machine/texture_cache.h"

// Results of `quarry bench stream` for one store: the numbers behind tables 1 to 3 and figures 6 to 9 of
// Purcell et al. 2002.

namespace quarry::laboratory {

/// One run of the machine with all words counted.
struct CountedRun {
  MachineCounts counts;
  std::array<MemoryWords, kKernels> words;            ///< by kernel, all runs together (table 1)
  std::array<uint64_t, kDataKinds> bytes{};           ///< read and written, by kind (figure 8)
  std::array<uint64_t, kDataKinds> cached_bytes{};    ///< the same behind a texture cache (figure 9)
  uint64_t triangle_accesses = 0, triangle_hits = 0;  ///< of vertices, in the cache
  std::vector<float> pixels;  ///< see MeansOf(); of Study::branching, else dropped once compared

  uint64_t all_bytes() const;
  uint64_t all_cached_bytes() const;
};

/// Instructions of one run of a kernel: of its multipass form, without its body but with Leave; of its body,
/// which runs as often as the machine takes steps; and of the Leave that falls to a run, which the branching
/// machine calls beside the body.
struct KernelInstructions {
  double form = 0, body = 0, leave = 0;
};
using Instructions = std::array<KernelInstructions, kKernels>;

/// Gathers the counts of a run of the machine.
CountedRun CountsOf(const CountingMemory& memory, const TextureCache& cache, const MachineCounts& counts,
                    bool multipass);

/// The cost model of section 3.2, C = R (Cr + v Cv + t Ct + s Cs), in instructions: for each kernel the cost
/// of a run, from one picture, times the runs of another. Without the term of the stencil, whose reads are no
/// kernel's: they are MachineCounts::places bytes. `branching`: bodies alone.
double PredictedInstructions(const Instructions& instructions, const MachineCounts& counts, bool branching);
/// The same in 32-bit words: of each kernel the words a run from one picture, by the runs of another.
double PredictedWords(const CountedRun& measured, const MachineCounts& counts);

/// One row of table 2.
struct OracleRow {
  std::string name;
  MachineCounts counts;
};

/// A renderer by both machines, for the shade kernels of table 1, table 3 and the last columns of figure 9.
struct RendererRow {
  Renderer renderer;
  CountedRun multipass, branching;
  std::optional<Instructions> instructions;
  bool same_schedules = false;         ///< multipass gives the same bits
  std::optional<bool> same_as_render;  ///< none: Quarry has no such mode
};

struct StudyOptions {
  CameraSpec camera;
  uint32_t size = 512;       ///< pixels a side
  uint32_t path_size = 256;  ///< of the path tracer's picture
  uint32_t path_samples = 4;
  Oracle oracle;
  Unrolling unrolling{4, 2};  ///< of the unrolled run
  uint32_t tile = 32;         ///< of the tiled run, pixels a side
  TextureCacheOptions cache;
};

struct Study {
  std::string accelerator;
  std::vector<OracleRow> oracles;
  CountedRun multipass, branching, unrolled, tiled;
  std::vector<RendererRow> renderers;  ///< the first is the ray caster
  /// All oracles, the unrolled, the tiled and the branching run give the same bits.
  bool same_runs = true;
};

}  // namespace quarry::laboratory
