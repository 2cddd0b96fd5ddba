#pragma once

#include <cstdint>

namespace quarry {

/// Limits this process to the address space that it has now and `more` bytes: allocations beyond fail
/// (RLIMIT_AS). Nothing is limited in builds with sanitizers, which map terabytes for themselves.
void LimitAddressSpace(uint64_t more);

}  // namespace quarry
