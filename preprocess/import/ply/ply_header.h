#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/model_reader.h"

namespace quarry {

enum class PlyType : uint8_t { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

/// Bytes of one value in a binary file.
constexpr uint32_t SizeOf(PlyType type) {
  constexpr uint32_t kSizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<int>(type)];
}

constexpr bool IsReal(PlyType type) { return type == PlyType::kFloat32 || type == PlyType::kFloat64; }

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;   ///< Of the value, or of a list's values.
  std::optional<PlyType> count_type;  ///< Of a list's count, an integer type; none for a single value.
};

struct PlyElement {
  std::string name;
  uint64_t count = 0;  ///< As the file claims; nothing may be allocated from it.
  std::vector<PlyProperty> properties;
};

enum class PlyEncoding { kAscii, kBinaryLittleEndian, kBinaryBigEndian };

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::kAscii;
  std::vector<PlyElement> elements;  ///< In file order, names differ.
  std::string texture_file;          ///< that "comment TextureFile" names (MeshLab)
  uint64_t lines = 0;                ///< Lines the header takes.

  const PlyElement* Find(std::string_view name) const;
};

/// Reads the header at the start of `bytes` and leaves `bytes` behind it. Comments, obj_info and unknown
/// keywords are passed over; lines may end in LF, CR LF or CR. Errors: no "ply" at the start, no or unknown
/// format, an unknown type, a count that is none, an element named twice, no end_header; each with its line.
/// At most 256 elements and 4096 properties.
Result<PlyHeader> ReadPlyHeader(ModelReader& bytes);

}  // namespace quarry
