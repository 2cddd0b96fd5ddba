#pragma once

#include <cstdint>

namespace quarry {

/// Limits the address space of this process (RLIMIT_AS) to its present size plus `more`; allocations beyond
/// that fail.
/// Units: `more` in bytes.
/// Errors: none are reported. Does nothing in builds with sanitizers, which map terabytes for themselves.
void LimitAddressSpace(uint64_t more);

}  // namespace quarry
