#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/voxel/store_header.h"
#include "common/voxel/store_reader.h"
#include "tests/support/stores/small_store.h"

namespace quarry::test {

/// A store in memory whose last section may be followed by zeros that take no memory. Counts the bytes read.
class MemoryFile final : public RandomAccessFile {
 public:
  struct Counts {
    uint64_t read = 0;
  };
  MemoryFile(std::vector<char> bytes, uint64_t size, std::shared_ptr<Counts> counts)
      : bytes_(std::move(bytes)), size_(size), counts_(std::move(counts)) {}
  const std::string& path() const override { return path_; }
  uint64_t size() const override { return size_; }
  Status ReadAt(uint64_t offset, std::span<std::byte> out) const override {
    counts_->read += out.size();
    std::ranges::fill(out, std::byte{0});
    if (offset < bytes_.size())
      std::memcpy(out.data(), bytes_.data() + offset, std::min<uint64_t>(out.size(), bytes_.size() - offset));
    return {};
  }

 private:
  std::string path_ = "memory";
  std::vector<char> bytes_;
  uint64_t size_;
  std::shared_ptr<Counts> counts_;
};

/// A store that a test changes.
class Changed {
 public:
  explicit Changed(const std::string& path) : bytes(test::ReadFile(path)), size(bytes.size()) {}

  template <class T>
  void Put(uint64_t at, T value) {
    std::memcpy(bytes.data() + at, &value, sizeof value);
  }
  template <class T>
  T Get(uint64_t at) const {
    T value;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
  }
  /// Where the entry of a section is in the table.
  uint64_t Entry(SectionType type) const {
    for (uint64_t at = kStoreHeaderBytes;; at += kSectionEntryBytes)
      if (Get<uint32_t>(at) == static_cast<uint32_t>(type)) return at;
  }
  /// Where a section begins.
  uint64_t Begin(SectionType type) const { return Get<uint64_t>(Entry(type) + 8); }
  /// Gives the last section another type, and a size that the file has in zeros.
  void ClaimLast(SectionType type, uint64_t section_size) {
    const uint64_t entry = Entry(SectionType::kModels);
    Put(entry, static_cast<uint32_t>(type));
    Put(entry + 16, section_size);
    size = Get<uint64_t>(entry + 8) + section_size;
    MendTable();
  }
  void MendTable() {
    const auto file = std::as_writable_bytes(std::span(bytes));
    Put(16, size);
    Put(48, Checksum(file.subspan(kStoreHeaderBytes, Get<uint32_t>(12) * kSectionEntryBytes)));
    Put(56, Checksum(file.first(56)));
  }
  Result<StoreReader> Open() { return StoreReader::Open(std::make_unique<MemoryFile>(bytes, size, counts)); }

  std::vector<char> bytes;
  uint64_t size;
  std::shared_ptr<MemoryFile::Counts> counts = std::make_shared<MemoryFile::Counts>();
};

}  // namespace quarry::test
