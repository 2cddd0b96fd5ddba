#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <utility>

#include "common/base/bytes.h"
#include "common/math/ordered_float.h"

// Codings of arrays for LZ4, which finds equal bytes but does not know numbers: differences to earlier
// values, stored byte by byte, all lowest bytes first. FORMAT.md lists the coding of each array.
// Thread-safe: all functions use only their arguments.

namespace quarry {

/// Maps a signed difference to an unsigned number that is small when the difference is near 0.
template <class T>
T ZigZag(T difference) {
  constexpr int kLast = static_cast<int>(sizeof(T)) * 8 - 1;
  return static_cast<T>(static_cast<T>(difference << 1) ^
                        static_cast<T>(-static_cast<T>(difference >> kLast)));
}
/// The inverse of ZigZag().
template <class T>
T UndoZigZag(T value) {
  return static_cast<T>(static_cast<T>(value >> 1) ^ static_cast<T>(-static_cast<T>(value & 1)));
}

/// Appends the lowest bytes of `count` numbers, then the next bytes of all, and so on. `number(i)` gives
/// number i and is called in order.
template <class T, class Number>
void PutPlanesOf(size_t count, Bytes& out, Number&& number) {
  const size_t begin = out.size();
  out.resize(begin + count * sizeof(T));
  std::byte* const plane = out.data() + begin;
  for (size_t i = 0; i < count; ++i) {
    const T value = number(i);
    for (size_t byte = 0; byte < sizeof(T); ++byte)
      plane[byte * count + i] = static_cast<std::byte>(value >> (8 * byte));
  }
}
template <class T>
void PutPlanes(std::span<const T> values, Bytes& out) {
  PutPlanesOf<T>(values.size(), out, [&](size_t i) { return values[i]; });
}

/// Vectors of four and eight numbers and of 16 bytes, of the compiler's own vector types.
using UInt4 = uint32_t __attribute__((vector_size(16)));
using UShort8 = uint16_t __attribute__((vector_size(16)));
using Byte16 = uint8_t __attribute__((vector_size(16)));

/// Converts eight bytes to 16-bit numbers.
inline UShort8 Widened(const uint8_t* bytes) {
  uint8_t __attribute__((vector_size(8))) eight;
  std::memcpy(&eight, bytes, sizeof eight);
  return __builtin_convertvector(eight, UShort8);
}

/// Sixteen 32-bit numbers in order, four in a vector.
struct UInt16x {
  UInt4 four[4];
};
/// Joins the next 16 bytes of each of four planes, `count` bytes apart.
inline UInt16x JoinPlanes(const uint8_t* plane, size_t count) {
  Byte16 bytes[4];
  for (size_t b = 0; b < 4; ++b) std::memcpy(&bytes[b], plane + b * count, sizeof bytes[b]);
  constexpr auto kLow = [](auto a, auto b) {
    return __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
  };
  constexpr auto kHigh = [](auto a, auto b) {
    return __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
  };
  constexpr auto kLowPairs = [](auto a, auto b) {
    return reinterpret_cast<UInt4>(__builtin_shufflevector(
        reinterpret_cast<UShort8>(a), reinterpret_cast<UShort8>(b), 0, 8, 1, 9, 2, 10, 3, 11));
  };
  constexpr auto kHighPairs = [](auto a, auto b) {
    return reinterpret_cast<UInt4>(__builtin_shufflevector(
        reinterpret_cast<UShort8>(a), reinterpret_cast<UShort8>(b), 4, 12, 5, 13, 6, 14, 7, 15));
  };
  const Byte16 low01 = kLow(bytes[0], bytes[1]), low23 = kLow(bytes[2], bytes[3]);
  const Byte16 high01 = kHigh(bytes[0], bytes[1]), high23 = kHigh(bytes[2], bytes[3]);
  return {{kLowPairs(low01, low23), kHighPairs(low01, low23), kLowPairs(high01, high23),
           kHighPairs(high01, high23)}};
}

/// Reads the values from index `first` on that PutPlanes() wrote. Requires: bytes.size() == values.size() *
/// sizeof(T).
template <class T>
void ReadPlanes(std::span<const std::byte> bytes, std::span<T> values, size_t first = 0) {
  const size_t count = values.size();
  const auto* plane = reinterpret_cast<const uint8_t*>(bytes.data());
  T* __restrict out = values.data();
  if constexpr (sizeof(T) == 2) {
    for (size_t i = first; i < count; ++i) out[i] = static_cast<T>(plane[i] | plane[count + i] << 8);
  } else {
    static_assert(sizeof(T) == 4);
    for (size_t i = first; i < count; ++i)
      out[i] = static_cast<T>(plane[i]) | static_cast<T>(plane[count + i]) << 8 |
               static_cast<T>(plane[2 * count + i]) << 16 | static_cast<T>(plane[3 * count + i]) << 24;
  }
}

/// Appends the zigzag differences of neighbours; for arrays whose neighbours are near each other.
template <class T>
void PutDifferences(std::span<const T> values, Bytes& out) {
  T last = 0;
  PutPlanesOf<T>(values.size(), out, [&](size_t i) {
    return ZigZag(static_cast<T>(values[i] - std::exchange(last, values[i])));
  });
}

/// The inverse of PutDifferences(). Requires: bytes.size() == 4 * values.size().
inline void ReadDifferences(std::span<const std::byte> bytes, std::span<uint32_t> values) {
  constexpr size_t kStep = 16, kLanes = 4;
  const size_t count = values.size(), whole = count / kStep * kStep;
  const auto* plane = reinterpret_cast<const uint8_t*>(bytes.data());
  UInt4 last{};  // the previous value in every lane
  for (size_t i = 0; i < whole; i += kStep) {
    const UInt16x zigzag = JoinPlanes(plane + i, count);
    for (size_t k = 0; k < kStep / kLanes; ++k) {
      const UInt4 zero{};
      UInt4 sums = (zigzag.four[k] >> 1) ^ -(zigzag.four[k] & 1);
      sums += __builtin_shufflevector(zero, sums, 0, 4, 5, 6);
      sums += __builtin_shufflevector(zero, sums, 0, 1, 4, 5);
      const UInt4 here = sums + last;
      last += __builtin_shufflevector(sums, sums, 3, 3, 3, 3);
      std::memcpy(&values[i + k * kLanes], &here, sizeof here);
    }
  }
  ReadPlanes(bytes, values, whole);
  uint32_t sum = last[0];
  for (size_t i = whole; i < count; ++i) values[i] = sum += UndoZigZag(values[i]);
}

/// Does so for 16-bit numbers, which are few. Requires: bytes.size() == 2 * values.size().
inline void ReadDifferences(std::span<const std::byte> bytes, std::span<uint16_t> values) {
  ReadPlanes(bytes, values);
  uint16_t sum = 0;
  for (uint16_t& value : values) value = sum = static_cast<uint16_t>(sum + UndoZigZag(value));
}

/// Appends indices numbered by first appearance, each as its distance below the next new index. A
/// new index gives 0.
inline void PutFromNewest(std::span<const uint16_t> indices, Bytes& out) {
  uint16_t next = 0;
  PutPlanesOf<uint16_t>(indices.size(), out, [&](size_t i) {
    const auto below = static_cast<uint16_t>(next - indices[i]);
    next = static_cast<uint16_t>(next + (below == 0));
    return below;
  });
}

/// The inverse of PutFromNewest(). Returns: false when an index is not below `limit`.
/// Requires: bytes.size() == 2 * indices.size().
inline bool ReadFromNewest(std::span<const std::byte> bytes, std::span<uint16_t> indices, uint32_t limit) {
  constexpr size_t kLanes = 8;
  const size_t count = indices.size(), whole = count / kLanes * kLanes;
  const auto* plane = reinterpret_cast<const uint8_t*>(bytes.data());
  UShort8 nexts{}, largests{};
  for (size_t i = 0; i < whole; i += kLanes) {
    const UShort8 zero{}, below = Widened(plane + i) | Widened(plane + count + i) << 8;
    const UShort8 fresh = reinterpret_cast<UShort8>(below == 0) & 1;
    UShort8 sums = fresh;
    sums += __builtin_shufflevector(zero, sums, 0, 8, 9, 10, 11, 12, 13, 14);
    sums += __builtin_shufflevector(zero, sums, 0, 1, 8, 9, 10, 11, 12, 13);
    sums += __builtin_shufflevector(zero, sums, 0, 1, 2, 3, 8, 9, 10, 11);
    const UShort8 index = nexts + (sums - fresh - below);
    nexts += __builtin_shufflevector(sums, sums, 7, 7, 7, 7, 7, 7, 7, 7);
    largests = index > largests ? index : largests;
    std::memcpy(&indices[i], &index, sizeof index);
  }
  ReadPlanes(bytes, indices, whole);
  uint16_t next = nexts[0], largest = 0;
  for (size_t lane = 0; lane < kLanes; ++lane) largest = std::max<uint16_t>(largest, largests[lane]);
  for (size_t i = whole; i < count; ++i) {
    const uint16_t below = indices[i];
    indices[i] = static_cast<uint16_t>(next - below);
    next = static_cast<uint16_t>(next + (below == 0));
    largest = std::max(largest, indices[i]);
  }
  return indices.empty() || largest < limit;
}

}  // namespace quarry
