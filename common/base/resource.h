#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>

namespace quarry {

/// Peak resident memory of this process so far (VmHWM). 0 when the system does not tell. Thread-safe.
uint64_t PeakResidentBytes();

/// Raises the limit of open files (RLIMIT_NOFILE) to the system's maximum. For programs that listen: each
/// connection is an open file. Call first in main.
void RaiseDescriptorLimit();
/// The number of files that this process may open.
uint64_t DescriptorLimit();

/// Memory that this process may use: the machine's, or less when its cgroup has a limit.
uint64_t MemoryLimitBytes();

/// Processors that this process may use: its affinity mask (sched_setaffinity), or fewer when its cgroup has
/// a quota. Rounded up; at least 1.
unsigned UsableProcessors();

/// The machine's name in its network.
std::string HostName();

/// Processor time of the calling thread.
uint64_t ThreadTimeUs();
/// Wall-clock time since `start`.
uint64_t MicrosecondsSince(std::chrono::steady_clock::time_point start);
double SecondsSince(std::chrono::steady_clock::time_point start);

/// Makes the allocator return buffers of `large` bytes and more to the system at once and keep few arenas.
/// Resident memory then follows the memory in use; each such buffer costs page faults. Call first in main.
void KeepHeapSmall(size_t large = 128 << 10);

}  // namespace quarry
