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
  PlyType type = PlyType::kFloat32;   ///< of the value, or of a list's values
  std::optional<PlyType> count_type;  ///< of a list's count, an integer type; absent for a single value
};

struct PlyElement {
  std::string name;
  uint64_t count = 0;  ///< as the file claims; never a size to allocate
  std::vector<PlyProperty> properties;
};

enum class PlyEncoding { kAscii, kBinaryLittleEndian, kBinaryBigEndian };

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::kAscii;
  std::vector<PlyElement> elements;        ///< in file order, with distinct names
  std::vector<std::string> texture_files;  ///< from lines "comment TextureFile" (MeshLab)
  uint64_t lines = 0;                      ///< of the header

  const PlyElement* Find(std::string_view name) const;
};

/// Images that a header may name; further ones are ignored.
inline constexpr size_t kMostTextureFiles = 4096;

/// Reads the header at the start of `bytes` and stops after it. Comments, obj_info and unknown keywords are
/// ignored; lines end in LF, CR LF or CR. Limits: 256 elements, 4096 properties.
/// Errors, with the line: no "ply" at the start, no or unknown format, unknown type, malformed count,
/// duplicate element, no end_header.
Result<PlyHeader> ReadPlyHeader(ModelReader& bytes);

}  // namespace quarry
