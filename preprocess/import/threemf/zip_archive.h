#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "common/base/status.h"

struct zip;
struct zip_file;

namespace quarry {

/// A zip archive, ZIP64 or not, whose parts are unpacked in pieces. Errors: a sentence with the archive's
/// path and the part. Thread safety: none.
class ZipArchive {
 public:
  /// Most bytes that the archive's directory may have: about 10,000 parts. It is held in memory, in up to 8
  /// times as many bytes.
  static constexpr uint64_t kMostDirectoryBytes = 1 << 20;

  /// Units: unpack_limit in bytes, over all of Read() since Open() or RestartLimit(); 0: the default limit of
  /// ModelReader. Errors: cannot be opened; no zip archive; its directory is damaged or too large.
  static Result<ZipArchive> Open(const std::string& path, uint64_t unpack_limit);
  ZipArchive(ZipArchive&& other) noexcept;
  ZipArchive& operator=(ZipArchive&&) = delete;
  ~ZipArchive();

  const std::string& path() const { return path_; }
  /// Units: bytes of the archive.
  uint64_t size() const;

  /// The number of the part with that name, the case of ASCII letters apart. Names have no slash in front.
  std::optional<uint64_t> Find(const std::string& name) const;
  /// The beginning of the part's name, for error sentences.
  std::string Name(uint64_t part) const;
  /// Units: bytes once unpacked, as the directory states them.
  uint64_t StatedSize(uint64_t part) const;

  /// Begins to read a part; another that is open is closed. Errors: it is encrypted, packed by a method that
  /// 3MF does not have, or damaged.
  Status OpenPart(uint64_t part);
  /// Unpacks the next bytes; 0 at the part's end, whose checksum has been compared then. Errors: the part is
  /// damaged; the limit is reached. Requires: OpenPart().
  Result<size_t> Read(std::span<char> out);
  /// Counts from 0 again.
  void RestartLimit() { unpacked_ = 0; }

 private:
  struct Source;
  ZipArchive(std::string path, std::unique_ptr<Source> source, uint64_t most, bool by_option);
  tl::unexpected<Error> Damaged(const std::string& why) const;

  std::string path_;
  std::unique_ptr<Source> source_;
  zip* archive_ = nullptr;
  zip_file* part_ = nullptr;
  std::string part_name_;
  uint64_t unpacked_ = 0, most_;
  bool limited_by_option_;
};

}  // namespace quarry
