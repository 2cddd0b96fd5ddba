#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_decoding.h"

namespace quarry {

/// Elements of an accessor that were decoded with the mesh around them: packed, one after the other.
struct GltfElements {
  uint64_t offset = 0, count = 0;  ///< offset in the decoded bytes; elements
  uint32_t component_type = 0;     ///< glTF's number
  uint32_t components = 0;
  bool normalized = false;
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

  /// The elements of accessors, by the accessors' numbers.
  using Elements = std::map<uint64_t, GltfElements>;
  /// Accessors that are opened from now on take these elements, if they are among them. Null: none. Requires:
  /// `elements` outlives the accessors' opening.
  void UseElements(const Elements* elements) { elements_ = elements; }
  /// Null: the accessor's elements stand in its buffer view.
  const GltfElements* FindElements(uint64_t accessor) const;

 private:
  Status Create();

  GltfDecoding decoding_;
  int fd_ = -1;
  uint64_t size_ = 0;
  std::map<uint64_t, uint64_t> views_;
  const Elements* elements_ = nullptr;
};

}  // namespace quarry
