// Opens the bytes as a scene store and reads all of it.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>

#include "common/voxel/store_reader.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const int fd = memfd_create("store", 0);
  if (fd < 0 || write(fd, data, size) != static_cast<ssize_t>(size)) std::abort();
  const auto store = quarry::StoreReader::Open("/proc/self/fd/" + std::to_string(fd));
  if (store) {
    const quarry::Status status = store->Verify([](uint64_t, uint64_t) {});
    if (!status && status.error().message.empty()) std::abort();
  } else if (store.error().message.empty()) {
    std::abort();
  }
  close(fd);
  return 0;
}
