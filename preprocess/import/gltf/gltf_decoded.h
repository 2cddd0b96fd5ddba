#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>

#include "common/base/status.h"

namespace quarry {

/// How to decode the compressed parts of a glTF file.
struct GltfDecoding {
  std::string folder;              ///< for decoded bytes; empty: the system's folder for temporary files
  uint64_t memory = 256ull << 20;  ///< bytes, a ceiling; a decoder in this process takes half
};

/// The decoded bytes of a glTF file's compressed parts. They lie in one temporary file without a name, since
/// parts are read more than once and in any order. Memory: 100 bytes a part. Thread safety: none.
class GltfDecoded {
 public:
  /// Bytes of all parts. The positions of the most vertices that a scene may have take 48 GiB.
  static constexpr uint64_t kMostBytes = 64ull << 30;

  explicit GltfDecoded(GltfDecoding decoding) : decoding_(std::move(decoding)) {}
  ~GltfDecoded();
  GltfDecoded(GltfDecoded&& other) noexcept;
  GltfDecoded& operator=(GltfDecoded&&) = delete;

  const GltfDecoding& decoding() const { return decoding_; }

  /// Appends bytes and returns their offset. Errors: disk full; more than kMostBytes.
  Result<uint64_t> Append(std::span<const std::byte> bytes);
  /// Fills `out` from byte `offset`. Errors: read errors; bytes that were never appended.
  Status Read(uint64_t offset, std::span<std::byte> out) const;

  /// The offset of a buffer view's decoded bytes, if it has been decoded.
  std::optional<uint64_t> FindView(uint64_t view) const;
  void NoteView(uint64_t view, uint64_t offset) { views_[view] = offset; }

 private:
  Status Create();

  GltfDecoding decoding_;
  int fd_ = -1;
  uint64_t size_ = 0;
  std::map<uint64_t, uint64_t> views_;
};

}  // namespace quarry
