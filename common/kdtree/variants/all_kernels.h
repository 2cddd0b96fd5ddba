#pragma once

#include <span>

#include "common/kdtree/kernels.h"

namespace quarry {

/// The kernels that renders use, then their variants, as far as this processor and QUARRY_ISA allow, of each
/// the widest vectors first; last the kernels of GPUs, one lane at a time. Thread-safe.
std::span<const Kernel> AllKernels();

}  // namespace quarry
