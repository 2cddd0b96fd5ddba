// Opens the bytes as a scene store and reads all of it: as they are, and with all checksums made right, which
// guessing would never come past.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "common/voxel/store_reader.h"
#include "tests/fuzz/store_mend.h"

namespace {

void Read(const void* data, size_t size) {
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
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  Read(data, size);
  const auto* bytes = reinterpret_cast<const std::byte*>(data);
  std::vector<std::byte> mended(bytes, bytes + size);
  quarry::fuzz::MendStore(mended);
  Read(mended.data(), mended.size());
  return 0;
}
