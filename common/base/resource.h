#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>

namespace quarry {

/// Peak resident memory of this process so far (VmHWM), in bytes.
uint64_t PeakResidentBytes();

/// Raises the number of files that this process may open (RLIMIT_NOFILE) as far as the system lets it: for
/// programs that listen, whose every connection is one. Call first in main.
void RaiseDescriptorLimit();
/// Files that this process may open.
uint64_t DescriptorLimit();

/// Bytes of memory that this process may use: the machine's, or less where its cgroup has a limit.
uint64_t MemoryLimitBytes();

/// Processors that this process may use: those it is bound to (sched_setaffinity), or fewer where its cgroup
/// has a quota (rounded up). At least 1.
unsigned UsableProcessors();

/// The machine's name in its network.
std::string HostName();

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
