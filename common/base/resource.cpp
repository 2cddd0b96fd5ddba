#include "common/base/resource.h"

#include <malloc.h>
#include <sched.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>
#include <thread>

namespace quarry {

const char* SentenceOf(const std::exception& exception) {
  if (dynamic_cast<const std::bad_alloc*>(&exception)) return kNoMemory;
  const auto* const system = dynamic_cast<const std::system_error*>(&exception);
  const bool refused = system && (system->code() == std::errc::resource_unavailable_try_again ||
                                  system->code() == std::errc::not_enough_memory);
  return refused ? kNoThread : exception.what();
}

uint64_t PeakResidentBytes() {
  std::ifstream status("/proc/self/status");
  std::string word;
  while (status >> word) {
    if (word != "VmHWM:") continue;
    uint64_t kib = 0;
    status >> kib;
    return kib * 1024;
  }
  return 0;
}

void RaiseDescriptorLimit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= limit.rlim_max) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

uint64_t DescriptorLimit() {
  rlimit limit{};
  return ::getrlimit(RLIMIT_NOFILE, &limit) == 0 ? limit.rlim_cur : 1024;
}

namespace {

/// Calls `look(folder, v2)` for the cgroup of this process under `controller` and for every group above it.
/// Handles versions 1 and 2 of cgroups.
template <class Look>
void ForEachGroup(const std::string& controller, Look look) {
  std::ifstream membership("/proc/self/cgroup");
  std::string line;
  while (std::getline(membership, line)) {
    // "4:cpu,cpuacct:/group" in version 1, "0::/group" in version 2
    const size_t first = line.find(':'), second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
    const bool v2 = controllers == ",,";
    if (!v2 && controllers.find("," + controller + ",") == std::string::npos) continue;
    const std::string root = v2 ? "/sys/fs/cgroup" : "/sys/fs/cgroup/" + controller;
    for (std::string group = line.substr(second + 1);; group.resize(group.rfind('/'))) {
      look(root + group, v2);
      if (group.find('/') == std::string::npos) break;
    }
  }
}

}  // namespace

uint64_t MemoryLimitBytes() {
  uint64_t bytes =
      static_cast<uint64_t>(::sysconf(_SC_PHYS_PAGES)) * static_cast<uint64_t>(::sysconf(_SC_PAGE_SIZE));
  ForEachGroup("memory", [&](const std::string& group, bool v2) {
    uint64_t limit = 0;  // the text "max" fails to parse: no limit
    if (std::ifstream(group + (v2 ? "/memory.max" : "/memory.limit_in_bytes")) >> limit)
      bytes = std::min(bytes, limit);
  });
  return bytes;
}

unsigned UsableProcessors() {
  auto processors = static_cast<double>(std::max(1u, std::thread::hardware_concurrency()));
  // The mask holds 8,192 processors; on larger machines the call fails and all processors count.
  cpu_set_t bound[8];
  if (::sched_getaffinity(0, sizeof bound, bound) == 0)
    processors = static_cast<double>(CPU_COUNT_S(sizeof bound, bound));
  ForEachGroup("cpu", [&](const std::string& group, bool v2) {
    double quota = 0, period = 100000;  // microseconds; "max" and -1 mean no quota
    std::ifstream first(group + (v2 ? "/cpu.max" : "/cpu.cfs_quota_us"));
    if (!(first >> quota) || quota <= 0) return;
    if (v2)
      first >> period;
    else
      std::ifstream(group + "/cpu.cfs_period_us") >> period;
    if (period > 0) processors = std::min(processors, quota / period);
  });
  return std::max(1u, static_cast<unsigned>(std::ceil(processors)));
}

std::string HostName() {
  char name[256] = {};
  return ::gethostname(name, sizeof name - 1) == 0 && *name ? name : "localhost";
}

uint64_t ThreadTimeUs() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<uint64_t>(t.tv_sec) * 1000000 + static_cast<uint64_t>(t.tv_nsec) / 1000;
}

uint64_t MicrosecondsSince(std::chrono::steady_clock::time_point start) {
  const auto passed = std::chrono::steady_clock::now() - start;
  return static_cast<uint64_t>(std::chrono::duration_cast<std::chrono::microseconds>(passed).count());
}

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void KeepHeapSmall(size_t large) {
  ::mallopt(M_MMAP_THRESHOLD, static_cast<int>(large));
  ::mallopt(M_TRIM_THRESHOLD, static_cast<int>(2 * large));
  ::mallopt(M_ARENA_MAX, 2);
}

}  // namespace quarry
