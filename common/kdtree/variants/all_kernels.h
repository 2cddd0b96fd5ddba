#pragma once

#include <span>

#include "common/kdtree/kernels.h"

namespace quarry {

/// The kernels that renders use and their variants, as far as this processor and QUARRY_ISA allow: the widest
/// vectors first, and of each instruction set first the kernels that renders use. Thread-safe.
std::span<const Kernel> AllKernels();

/// The first of AllKernels() for this grouping that goes by treelets: the one with the widest vectors.
/// Requires: AllKernels() is not empty. Thread-safe.
const Kernel& FirstKernel(Grouping grouping);

}  // namespace quarry
