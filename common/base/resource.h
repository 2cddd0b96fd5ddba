#pragma once

#include <cstdint>

namespace quarry {

/// Peak resident memory of this process so far (VmHWM), in bytes.
uint64_t PeakResidentBytes();

/// Tells the allocator to give large buffers back to the system at once, and to keep few arenas, so that
/// resident memory follows what is in use. Call first in main.
void KeepHeapSmall();

}  // namespace quarry
