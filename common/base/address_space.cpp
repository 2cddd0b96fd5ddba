#include "common/base/address_space.h"

#include <sys/resource.h>
#include <unistd.h>

#include <fstream>

namespace quarry {

void LimitAddressSpace(uint64_t more) {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  uint64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  const rlim_t most = pages * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE)) + more;
  const rlimit limit{most, most};
  ::setrlimit(RLIMIT_AS, &limit);
#else
  (void)more;
#endif
}

}  // namespace quarry
