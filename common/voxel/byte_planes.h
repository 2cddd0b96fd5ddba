#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/math/ordered_float.h"

// How arrays are written before LZ4, which finds equal bytes but has no notion of numbers: as differences to
// what came before, and those byte by byte, all lowest bytes first. FORMAT.md lists what uses which.

namespace quarry {

/// Small for differences of either sign.
template <class T>
T ZigZag(T difference) {
  constexpr int kLast = static_cast<int>(sizeof(T)) * 8 - 1;
  return static_cast<T>(static_cast<T>(difference << 1) ^
                        static_cast<T>(-static_cast<T>(difference >> kLast)));
}
template <class T>
T UndoZigZag(T value) {
  return static_cast<T>(static_cast<T>(value >> 1) ^ static_cast<T>(-static_cast<T>(value & 1)));
}

/// Appends `values` byte by byte.
template <class T>
void PutPlanes(std::span<const T> values, Bytes& out) {
  for (size_t byte = 0; byte < sizeof(T); ++byte)
    for (const T value : values) out.push_back(static_cast<std::byte>(value >> (8 * byte)));
}

/// The reverse of PutPlanes, into `values`. Requires: `bytes` holds just so many.
template <class T>
void ReadPlanes(std::span<const std::byte> bytes, std::span<T> values) {
  const size_t count = values.size();
  const auto* plane = reinterpret_cast<const uint8_t*>(bytes.data());
  T* __restrict out = values.data();
  if constexpr (sizeof(T) == 2) {
    for (size_t i = 0; i < count; ++i) out[i] = static_cast<T>(plane[i] | plane[count + i] << 8);
  } else {
    static_assert(sizeof(T) == 4);
    for (size_t i = 0; i < count; ++i)
      out[i] = static_cast<T>(plane[i]) | static_cast<T>(plane[count + i]) << 8 |
               static_cast<T>(plane[2 * count + i]) << 16 | static_cast<T>(plane[3 * count + i]) << 24;
  }
}

/// Differences of neighbours, zigzag: for numbers near each other.
template <class T>
void PutDifferences(std::span<const T> values, Bytes& out) {
  std::vector<T> differences;
  differences.reserve(values.size());
  T last = 0;
  for (const T value : values) {
    differences.push_back(ZigZag(static_cast<T>(value - last)));
    last = value;
  }
  PutPlanes<T>(differences, out);
}

/// The reverse, into `values`.
template <class T>
void ReadDifferences(std::span<const std::byte> bytes, std::span<T> values) {
  ReadPlanes(bytes, values);
  T last = 0;
  for (T& value : values) value = last = static_cast<T>(last + UndoZigZag(value));
}

/// For indices numbered by first appearance: how far below the next new number each is, 0 for a new one.
inline void PutFromNewest(std::span<const uint16_t> indices, Bytes& out) {
  std::vector<uint16_t> below;
  below.reserve(indices.size());
  uint16_t next = 0;
  for (const uint16_t index : indices) {
    below.push_back(static_cast<uint16_t>(next - index));
    next = static_cast<uint16_t>(next + (index == next));
  }
  PutPlanes<uint16_t>(below, out);
}

/// The reverse, into `indices`. False when one is not below `limit`.
inline bool ReadFromNewest(std::span<const std::byte> bytes, std::span<uint16_t> indices, uint32_t limit) {
  ReadPlanes(bytes, indices);
  uint16_t next = 0, largest = 0;
  for (uint16_t& index : indices) {
    const uint16_t below = index;
    index = static_cast<uint16_t>(next - below);
    next = static_cast<uint16_t>(next + (below == 0));
    largest = std::max(largest, index);
  }
  return indices.empty() || largest < limit;
}

}  // namespace quarry
