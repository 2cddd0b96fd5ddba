#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/model_reader.h"
#include "preprocess/import/ply/ply_header.h"

namespace quarry {

/// How to treat a property of a row; decided once per element.
struct PlyStep {
  static constexpr uint8_t kSkip = 0xFF;
  static constexpr uint8_t kIndexList = 0xFE;
  static constexpr uint8_t kUvList = 0xFD;

  PlyType type;
  std::optional<PlyType> count_type;
  uint8_t target = kSkip;  ///< index into PlyRow::values, or a constant above
};

/// The wanted values of a row.
struct PlyRow {
  static constexpr size_t kMaxValues = 16;
  double values[kMaxValues] = {};
  std::vector<int64_t> indices;
  std::vector<float> uvs;  ///< u and v of each corner of a face
};

template <typename T, bool kSwap>
inline T LoadAs(const char* at) {
  T value;
  if constexpr (kSwap && sizeof(T) > 1) {
    char reversed[sizeof(T)];
    for (size_t i = 0; i < sizeof(T); ++i) reversed[i] = at[sizeof(T) - 1 - i];
    std::memcpy(&value, reversed, sizeof(T));
  } else {
    std::memcpy(&value, at, sizeof(T));
  }
  return value;
}

/// Calls `use` with a value of the C++ type of `type`.
template <typename Use>
inline auto WithType(PlyType type, Use&& use) {
  switch (type) {
    case PlyType::kInt8:
      return use(int8_t{});
    case PlyType::kUint8:
      return use(uint8_t{});
    case PlyType::kInt16:
      return use(int16_t{});
    case PlyType::kUint16:
      return use(uint16_t{});
    case PlyType::kInt32:
      return use(int32_t{});
    case PlyType::kUint32:
      return use(uint32_t{});
    case PlyType::kFloat32:
      return use(float{});
    case PlyType::kFloat64:
      break;
  }
  return use(double{});
}

/// Reads values of a binary PLY body. Each function returns false where the file ends early or contradicts
/// its header; Failure() gives the reason. Thread safety: none.
template <bool kSwap>
class BinaryPlySource {
 public:
  static constexpr bool kBinary = true;

  explicit BinaryPlySource(ModelReader& bytes) : bytes_(bytes) {}

  bool Scalar(PlyType type, double& value) {
    const uint32_t size = SizeOf(type);
    if (!bytes_.Ensure(size)) return false;
    value = Load(bytes_.data(), type);
    bytes_.Consume(size);
    return true;
  }

  bool Integer(PlyType type, int64_t& value) {
    double real;  // holds every integer of up to 32 bits
    if (!Scalar(type, real)) return false;
    value = static_cast<int64_t>(real);
    return true;
  }

  /// Appends `count` integers to `out`. Requires: count <= kMaxPolygonCorners; `type` is an integer type.
  bool Integers(PlyType type, uint64_t count, std::vector<int64_t>& out) {
    const size_t size = SizeOf(type);
    if (!bytes_.Ensure(count * size)) return false;
    const char* at = bytes_.data();
    WithType(type, [&](auto kind) {
      for (uint64_t i = 0; i < count; ++i, at += size)
        out.push_back(static_cast<int64_t>(LoadAs<decltype(kind), kSwap>(at)));
    });
    bytes_.Consume(count * size);
    return true;
  }

  bool SkipValues(PlyType type, uint64_t count) {
    return count <= bytes_.remaining() / SizeOf(type) && bytes_.Skip(count * SizeOf(type));
  }

  static double Load(const char* at, PlyType type) {
    return WithType(type, [at](auto kind) { return static_cast<double>(LoadAs<decltype(kind), kSwap>(at)); });
  }

  /// An integer of 32 bits.
  static uint32_t Word(const char* at) { return LoadAs<uint32_t, kSwap>(at); }

  ModelReader& bytes() const { return bytes_; }
  /// Concerns text alone.
  void LookForRows(uint64_t) {}
  bool EndRow() { return false; }
  tl::unexpected<Error> Failure(const std::string& where) const { return bytes_.Truncated("in " + where); }
  tl::unexpected<Error> FailHere(const std::string& what) const { return bytes_.FailHere(what); }

 private:
  ModelReader& bytes_;
};

/// Reads values of an ASCII body, separated by any white space, line ends included. If the file has enough
/// lines, each row begins on a new line, and values beyond the row are skipped.
class AsciiPlySource {
 public:
  static constexpr bool kBinary = false;

  AsciiPlySource(ModelReader& bytes, uint64_t lines_before) : bytes_(bytes), line_(lines_before + 1) {}

  bool Scalar(PlyType type, double& value);
  bool Integer(PlyType type, int64_t& value);
  bool Integers(PlyType type, uint64_t count, std::vector<int64_t>& out);
  bool SkipValues(PlyType type, uint64_t count);
  /// Decides from the buffered lines whether each of the body's `rows` rows has its own line.
  void LookForRows(uint64_t rows);
  /// Skips the rest of the line after the row's last value. Returns whether there was any.
  bool EndRow();

  ModelReader& bytes() const { return bytes_; }
  tl::unexpected<Error> Failure(const std::string& where) const;
  tl::unexpected<Error> FailHere(const std::string& what) const;

 private:
  /// Bytes of a number's word, at most.
  static constexpr size_t kLongestWord = 512;

  /// Reads the next word, cut to kLongestWord bytes; false at the end.
  bool Word(std::string_view& word);

  ModelReader& bytes_;
  uint64_t line_;
  bool by_line_ = false;
  std::string complaint_;  ///< why the last function returned false; empty: the file ended
};

}  // namespace quarry
