#include "common/program/run_helper.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <malloc.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "common/base/log.h"

namespace quarry {

int HelperBody(int argc, char** argv, int (*serve)(uint64_t memory, int out)) {
  if (argc != 2) {
    Log(fmt::format("{} BYTES: started by quarry-preprocess",
                    std::filesystem::path(argv[0]).filename().string()));
    return 2;
  }
  const int out = ::dup(1), nowhere = ::open("/dev/null", O_WRONLY);
  if (out < 0 || nowhere < 0) return 1;
  ::dup2(nowhere, 1);
  ::dup2(nowhere, 2);
  ::mallopt(M_ARENA_MAX, 1);
  return serve(std::strtoull(argv[1], nullptr, 10), out);
}

}  // namespace quarry
