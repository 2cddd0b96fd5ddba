#include "tests/fuzz/store_mend.h"

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "common/base/bytes.h"
#include "common/voxel/catalog.h"
#include "common/voxel/store_header.h"

namespace quarry::fuzz {
namespace {

using File = std::span<std::byte>;

template <class T>
T Get(File file, uint64_t at) {
  T value{};
  if (at <= file.size() && file.size() - at >= sizeof value)
    std::memcpy(&value, file.data() + at, sizeof value);
  return value;
}

template <class T>
void Put(File file, uint64_t at, T value) {
  if (at <= file.size() && file.size() - at >= sizeof value)
    std::memcpy(file.data() + at, &value, sizeof value);
}

/// Puts the checksum of `size` bytes from `offset` on at `at`.
void Mend(File file, uint64_t offset, uint64_t size, uint64_t at) {
  if (offset > file.size() || size > file.size() - offset) return;
  Put(file, at, Checksum(file.subspan(offset, size)));
}

/// VDIR: 72 bytes a voxel; its two blocks follow each other.
void MendVoxels(File file, uint64_t begin, uint64_t end) {
  for (uint64_t at = begin; at + 72 <= end; at += 72) {
    const auto hot = Get<uint64_t>(file, at);
    const auto hot_bytes = Get<uint32_t>(file, at + 8), shading_bytes = Get<uint32_t>(file, at + 24);
    Mend(file, hot, hot_bytes, at + 16);
    if (shading_bytes > 0) Mend(file, hot + hot_bytes, shading_bytes, at + 32);
  }
}

/// TEXD: a count, 20 bytes a texture, 24 a page.
void MendPages(File file, uint64_t begin, uint64_t end) {
  for (uint64_t at = begin + 4 + uint64_t{20} * Get<uint32_t>(file, begin); at + 24 <= end; at += 24)
    Mend(file, Get<uint64_t>(file, at), Get<uint32_t>(file, at + 8), at + 16);
}

}  // namespace

void MendStore(File file) {
  if (file.size() < kStoreHeaderBytes) return;
  const uint32_t sections = std::min(Get<uint32_t>(file, 12), kMaxSections);
  Put(file, 16, static_cast<uint64_t>(file.size()));
  // Blocks before the directory that has their checksums, sections before the table, that before the header.
  for (const bool directories : {true, false})
    for (uint64_t s = 0; s < sections; ++s) {
      const uint64_t at = kStoreHeaderBytes + s * kSectionEntryBytes;
      const auto type = static_cast<SectionType>(Get<uint32_t>(file, at));
      const auto offset = Get<uint64_t>(file, at + 8), size = Get<uint64_t>(file, at + 16);
      if (offset > file.size() || size > file.size() - offset) continue;
      if (directories && type == SectionType::kDirectory) MendVoxels(file, offset, offset + size);
      if (directories && type == SectionType::kTextureDirectory) MendPages(file, offset, offset + size);
      if (!directories && (Get<uint32_t>(file, at + 4) & kSectionOwnChecksums) == 0)
        Mend(file, offset, size, at + 24);
    }
  Mend(file, kStoreHeaderBytes, sections * kSectionEntryBytes, 48);
  Mend(file, 0, 56, 56);
}

}  // namespace quarry::fuzz
