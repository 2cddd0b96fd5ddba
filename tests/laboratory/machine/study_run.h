#pragma once

#include <cstring>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "tests/laboratory/machine/study.h"

// The runs of the machine that a study is made from, over one acceleration structure.

namespace quarry::laboratory {

/// Runs the machine over a structure. Each run has an address space of its own behind the scene's. Not
/// thread-safe.
template <class A>
class StudyRunner {
 public:
  /// Requires: options.cache is valid.
  StudyRunner(const A& accelerator, AddressSpace addresses, StudyOptions options)
      : accelerator_(accelerator), addresses_(addresses), options_(std::move(options)) {}

  /// Pixels and counts of one run.
  struct Plain {
    std::vector<float> pixels;
    MachineCounts counts;
  };
  Plain Multipass(const Picture& picture, const Oracle& oracle, const Unrolling& unrolling,
                  uint32_t tile) const {
    return RunPlain(picture, [&](auto& machine) { machine.RunMultipass(oracle, unrolling, tile); });
  }

  CountedRun CountedMultipass(const Picture& picture, const Unrolling& unrolling, uint32_t tile) const {
    return RunCounted(picture, true,
                      [&](auto& machine) { machine.RunMultipass(options_.oracle, unrolling, tile); });
  }
  CountedRun CountedBranching(const Picture& picture) const {
    return RunCounted(picture, false, [](auto& machine) { machine.RunBranching(0); });
  }

 private:
  template <class Body>
  Plain RunPlain(const Picture& picture, const Body& body) const {
    PlainMemory memory;
    AddressSpace addresses = addresses_;
    Machine<A, PlainMemory> machine(accelerator_, picture, memory, addresses);
    body(machine);
    return {MeansOf(machine.sums(), picture.context.view.spp), machine.counts()};
  }
  template <class Body>
  CountedRun RunCounted(const Picture& picture, bool multipass, const Body& body) const {
    TextureCache cache = *TextureCache::Create(options_.cache);
    CountingMemory memory(&cache);
    AddressSpace addresses = addresses_;
    Machine<A, CountingMemory> machine(accelerator_, picture, memory, addresses);
    body(machine);
    CountedRun run = CountsOf(memory, cache, machine.counts(), multipass);
    run.pixels = MeansOf(machine.sums(), picture.context.view.spp);
    return run;
  }

  const A& accelerator_;
  const AddressSpace addresses_;
  const StudyOptions options_;
};

/// Whether two pictures are the same bits.
inline bool SamePixels(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

}  // namespace quarry::laboratory
