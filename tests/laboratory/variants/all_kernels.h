#pragma once

#include <span>
#include <string>
#include <string_view>

#include "common/kdtree/kernels.h"
#include "tests/support/rendering/resident_scene.h"

namespace quarry {

/// A kernel as tables name it: one that renders use, or a variant that only tables and tests use.
struct Variant : KernelFunctions {
  std::string_view isa;
  std::string_view grouping;   ///< how rays share work: "wide packet", "stream", "wide", or a GPU's
  std::string_view algorithm;  ///< how the next leaf is found
  test::TreeLayout layout;     ///< of the trees that it needs
  bool of_gpu = false;         ///< takes the steps of a GPU's threads or warps

  std::string name() const;
};

std::string_view NameOf(Grouping grouping);

/// The kernels that renders use, as far as this processor and QUARRY_ISA allow, the widest vectors first;
/// then GpuKernels() where scalar kernels are allowed. Thread-safe.
std::span<const Variant> AllKernels();

/// The kernels of GPUs on the CPU, one lane at a time: as single threads ("steps", "wide steps") and as one
/// emulated warp ("warp", "wide warp"). Thread-safe.
std::span<const Variant> GpuKernels();

}  // namespace quarry
