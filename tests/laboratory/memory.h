#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/math/host_device.h"

// The memory of Purcell's machine: textures that kernels read at random, and streams that kernels read and
// write at the place of their ray. Kernels reach both only through a memory policy, so that the same kernel
// counts words, feeds a simulated cache, or does neither.

namespace quarry::laboratory {

/// Purposes of words read or written; the parts of figures 8 and 9 of Purcell et al. 2002.
enum class DataKind : uint32_t {
  kStencil,    ///< the states of rays, a byte each
  kState,      ///< streams between kernels
  kCells,      ///< cells of the grid, nodes of kd-trees
  kLists,      ///< lists of triangles
  kTriangles,  ///< vertices
  kShading,    ///< materials, normals and colours
};
inline constexpr uint32_t kDataKinds = 6;
inline constexpr const char* kDataKindNames[kDataKinds] = {"stencil", "state",     "cells",
                                                           "lists",   "triangles", "shading"};

/// A read-only array at `address` in the machine's memory. Units: bytes.
template <class T>
struct Texture {
  const T* data = nullptr;
  uint64_t address = 0;
  DataKind kind = DataKind::kCells;
  size_t size = 0;  ///< elements
};

/// An array with an element a ray.
template <class T>
struct Stream {
  T* data = nullptr;
  uint64_t address = 0;
  DataKind kind = DataKind::kState;
};

/// Gives out addresses in the machine's memory, one array behind the other, each at a multiple of
/// 12,288 bytes: a page, and whole lines of 48 bytes. Not thread-safe.
class AddressSpace {
 public:
  uint64_t Take(size_t bytes) {
    const uint64_t at = next_;
    next_ += (bytes + kAlignment - 1) / kAlignment * kAlignment;
    return at;
  }
  template <class T>
  Texture<T> TextureOf(const std::vector<T>& data, DataKind kind) {
    return {data.data(), Take(data.size() * sizeof(T)), kind, data.size()};
  }
  template <class T>
  Stream<T> StreamOf(std::vector<T>& data, DataKind kind = DataKind::kState) {
    return {data.data(), Take(data.size() * sizeof(T)), kind};
  }

 private:
  static constexpr uint64_t kAlignment = 12288;
  uint64_t next_ = kAlignment;
};

/// Memory of which nothing is counted.
struct PlainMemory {
  template <class T>
  QUARRY_HOST_DEVICE const T& Fetch(const Texture<T>& texture, size_t i) {
    return texture.data[i];
  }
  template <class T>
  const T& Load(const Stream<T>& stream, size_t i) {
    return stream.data[i];
  }
  template <class T>
  void Store(const Stream<T>& stream, size_t i, const T& value) {
    stream.data[i] = value;
  }
};

}  // namespace quarry::laboratory
