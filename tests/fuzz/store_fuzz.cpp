// Opens the bytes as a scene store and reads all of it, parts too: as they are, and with all checksums made
// right, which guessing would never come past.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "common/voxel/part_tree.h"
#include "common/voxel/store_reader.h"
#include "tests/fuzz/store_mend.h"

namespace {

/// Parts are found and selected by what the store itself names.
void Select(const quarry::PartTree& tree) {
  for (uint32_t part = 0; part < std::min(tree.size(), 16u); ++part) {
    const std::string path = tree.Path(part);
    const auto bits = tree.Resolve(std::vector<std::string>{path, "*" + path});
    if (!bits || ((*bits)[part / 64] >> part % 64 & 1) == 0) std::abort();
    if (tree.Find(path, 0, 4).parts.size() > 4) std::abort();
  }
}

void Read(const void* data, size_t size) {
  const int fd = memfd_create("store", 0);
  if (fd < 0 || write(fd, data, size) != static_cast<ssize_t>(size)) std::abort();
  const auto store = quarry::StoreReader::Open("/proc/self/fd/" + std::to_string(fd));
  if (store) {
    const quarry::Status status = store->Verify([](uint64_t, uint64_t) {});
    if (!status && status.error().message.empty()) std::abort();
    if (const auto tree = quarry::PartTree::Read(*store)) Select(**tree);
    if (const auto attributes = store->part_sections().ReadAttributes())
      for (uint32_t part = 0; part < 16; ++part) (void)attributes->Of(part);
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
