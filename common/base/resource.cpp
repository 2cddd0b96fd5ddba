#include "common/base/resource.h"

#include <malloc.h>

#include <fstream>
#include <string>

namespace quarry {

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

void KeepHeapSmall(size_t large) {
  ::mallopt(M_MMAP_THRESHOLD, static_cast<int>(large));
  ::mallopt(M_TRIM_THRESHOLD, static_cast<int>(2 * large));
  ::mallopt(M_ARENA_MAX, 2);
}

}  // namespace quarry
