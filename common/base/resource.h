#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <new>
#include <string>
#include <system_error>

#include "common/base/status.h"

namespace quarry {

/// Peak resident memory of this process so far (VmHWM). 0 when it is unknown. Thread-safe.
uint64_t PeakResidentBytes();

/// Raises the limit of open files (RLIMIT_NOFILE) to the system's maximum. For programs that listen: each
/// connection is an open file. Call first in main.
void RaiseDescriptorLimit();
/// The number of files that this process may open.
uint64_t DescriptorLimit();

/// Memory that this process may use: the machine's, or less when its cgroup has a limit.
uint64_t MemoryLimitBytes();

/// The sentences for a failed allocation, and for a thread that the system refuses.
inline constexpr const char* kNoMemory =
    "no memory is left; raise its limit (ulimit -v, the job's or the cgroup's), or give a smaller --cache, "
    "--memory or --threads";
inline constexpr const char* kNoThread =
    "the system refuses a thread; raise the limit of processes (ulimit -u) or of memory (ulimit -v), or give "
    "fewer "
    "--threads";
/// The sentence for an exception of the standard library: kNoMemory, kNoThread, or its own text.
const char* SentenceOf(const std::exception& exception);

/// `work()`, a Result or Status; an error with SentenceOf() where it throws for want of memory or of a
/// thread. Threads call their work so: the job fails, and the program lives.
template <class Work>
auto WithinLimits(Work&& work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::bad_alloc&) {
    return tl::unexpected<Error>(Error{kNoMemory, ErrorKind::kMemory});
  } catch (const std::system_error& e) {
    return tl::unexpected<Error>(Error{SentenceOf(e), ErrorKind::kMemory});
  }
}

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
