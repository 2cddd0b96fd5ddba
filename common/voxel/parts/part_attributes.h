#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/status.h"
#include "common/voxel/store_names.h"

namespace quarry {

/// Most bytes of a part's attributes, and most levels of objects and arrays in them.
inline constexpr size_t kMostAttributeBytes = 16384;
inline constexpr int kMostAttributeLevels = 16;

/// Attributes of a part, as the model states them, for writing.
struct StatedAttributes {
  uint32_t part = 0;
  std::string json;  ///< IsAttributes()
};

/// Whether a text is a JSON object with members, within the limits above.
bool IsAttributes(std::string_view json);

/// Encodes the section PATT. Requires: ascending numbers of parts, each once.
Bytes EncodePartAttributes(std::span<const StatedAttributes> attributes);

/// The section PATT of a store: attributes of parts by number. The texts stay in the file. Memory: 16 bytes
/// a part that has attributes. Thread-safe.
class PartAttributes {
 public:
  /// `file` must outlive this. Errors: a read error; permanent: a size other than the entries state; numbers
  /// that do not ascend, or are not below `part_count`; a text of no byte or beyond kMostAttributeBytes.
  static Result<PartAttributes> Read(const RandomAccessFile& file, StoreNames::Place place,
                                     uint64_t part_count);

  size_t size() const { return entries_.size(); }
  /// The attributes of a part, a JSON object; empty: it has none. Errors: a read error; permanent: a text
  /// that is not IsAttributes().
  Result<std::string> Of(uint32_t part) const;
  /// Errors: as Of(), of all parts.
  Status Check() const;

 private:
  struct Entry {
    uint32_t part = 0, bytes = 0;
    uint64_t begin = 0;  ///< within the file
  };
  PartAttributes(const RandomAccessFile& file, uint64_t section) : file_(&file), section_(section) {}
  Result<std::string> Text(const Entry& entry) const;
  tl::unexpected<Error> Damaged(const std::string& how) const;

  const RandomAccessFile* file_;
  uint64_t section_;  ///< the place of the section in the file
  std::vector<Entry> entries_;
};

}  // namespace quarry
