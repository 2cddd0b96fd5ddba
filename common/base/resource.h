#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace quarry {

/// Peak resident memory of this process so far (VmHWM), in bytes.
uint64_t PeakResidentBytes();

/// Microseconds of processor time that the calling thread has had.
uint64_t ThreadTimeUs();
/// As time passes.
uint64_t MicrosecondsSince(std::chrono::steady_clock::time_point start);
double SecondsSince(std::chrono::steady_clock::time_point start);

/// Tells the allocator to give buffers of `large` bytes and more back to the system at once, and to keep few
/// arenas, so that resident memory follows what is in use; each such buffer costs page faults. Call first in
/// main.
void KeepHeapSmall(size_t large = 128 << 10);

}  // namespace quarry
