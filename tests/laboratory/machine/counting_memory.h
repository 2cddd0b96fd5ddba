#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/base/check.h"
#include "tests/laboratory/machine/texture_cache.h"
#include "tests/laboratory/memory.h"

namespace quarry::laboratory {

inline constexpr uint32_t kMostKernels = 16;

/// Words of 32 bits; an element of another length counts as the words that hold it. These are the columns of
/// table 1 of Purcell et al. 2002.
struct MemoryWords {
  uint64_t read = 0;     ///< R: from streams
  uint64_t written = 0;  ///< W: to streams
  uint64_t fetched = 0;  ///< M: from textures

  bool operator==(const MemoryWords&) const = default;
  MemoryWords& operator+=(const MemoryWords& other) {
    read += other.read;
    written += other.written;
    fetched += other.fetched;
    return *this;
  }
};

/// Bytes of the stencil, whose values have 8 bits.
struct StencilBytes {
  uint64_t read = 0;     ///< RS
  uint64_t written = 0;  ///< WS

  bool operator==(const StencilBytes&) const = default;
  StencilBytes& operator+=(const StencilBytes& other) {
    read += other.read;
    written += other.written;
    return *this;
  }
};

/// A memory policy that counts words by kernel and by kind, and sends reads through a simulated cache.
///
/// The cache is a GPU's of 2002. It holds all data read as texture: textures, and streams, which thereby
/// displace textures (Purcell et al. 2002, sections 3.1 and 5.3). Two things do not go through it:
///   Stores go to the framebuffer, which has no part in the texture cache. They allocate no line. The stream
///   that a pass writes is another texture than the one that it reads, so that lines read in the pass stay
///   good to its end; then the streams that it wrote take the places of the streams that it read, and all
///   their lines are dropped.
///   The stencil is read by the early fragment kill (section 2.2), not by a fragment program.
/// Memory for the figures is O(streams). Not thread-safe.
class CountingMemory {
 public:
  /// `cache`: none, or a cache that outlives this.
  explicit CountingMemory(TextureCache* cache = nullptr) : cache_(cache) {}

  /// Begins a pass of `kernel`: call it before each pass, also where the kernel stays the same, or its
  /// streams come from the cache as they were before the last pass. Requires: kernel < kMostKernels.
  void SetKernel(uint32_t kernel) {
    QUARRY_CHECK_LT(kernel, kMostKernels);
    EndPass();
    kernel_ = kernel;
  }

  template <class T>
  const T& Fetch(const Texture<T>& texture, size_t i) {
    if (texture.kind == DataKind::kStencil) {
      stencil_[kernel_].read += sizeof(T);
    } else {
      words(texture.kind).fetched += kWords<T>;
      Cache(texture.kind, texture.address + i * sizeof(T), sizeof(T));
    }
    return texture.data[i];
  }

  template <class T>
  const T& Load(const Stream<T>& stream, size_t i) {
    if (stream.kind == DataKind::kStencil) {
      stencil_[kernel_].read += sizeof(T);
    } else {
      words(stream.kind).read += kWords<T>;
      Cache(stream.kind, stream.address + i * sizeof(T), sizeof(T));
    }
    return stream.data[i];
  }

  template <class T>
  void Store(const Stream<T>& stream, size_t i, const T& value) {
    if (stream.kind == DataKind::kStencil) {
      stencil_[kernel_].written += sizeof(T);
    } else {
      words(stream.kind).written += kWords<T>;
      if (cache_)
        Written(stream.address, stream.address + i * sizeof(T), stream.address + (i + 1) * sizeof(T));
    }
    stream.data[i] = value;
  }

  /// All but the stencil. Requires: kernel < kMostKernels.
  MemoryWords OfKernel(uint32_t kernel) const {
    QUARRY_CHECK_LT(kernel, kMostKernels);
    MemoryWords sum;
    for (const MemoryWords& words : words_[kernel]) sum += words;
    return sum;
  }
  /// Zero for the stencil, whose bytes are counted apart.
  MemoryWords OfKind(DataKind kind) const {
    MemoryWords sum;
    for (const auto& kernel : words_) sum += kernel[static_cast<uint32_t>(kind)];
    return sum;
  }
  /// Requires: kernel < kMostKernels.
  MemoryWords Of(uint32_t kernel, DataKind kind) const {
    QUARRY_CHECK_LT(kernel, kMostKernels);
    return words_[kernel][static_cast<uint32_t>(kind)];
  }
  MemoryWords Total() const {
    MemoryWords sum;
    for (uint32_t kernel = 0; kernel < kMostKernels; ++kernel) sum += OfKernel(kernel);
    return sum;
  }
  /// Requires: kernel < kMostKernels.
  StencilBytes StencilOfKernel(uint32_t kernel) const {
    QUARRY_CHECK_LT(kernel, kMostKernels);
    return stencil_[kernel];
  }
  StencilBytes Stencil() const {
    StencilBytes sum;
    for (const StencilBytes& bytes : stencil_) sum += bytes;
    return sum;
  }

 private:
  template <class T>
  static constexpr uint64_t kWords = (sizeof(T) + 3) / 4;

  /// The part of a stream that the pass has written. Units: addresses.
  struct WrittenRange {
    uint64_t stream, begin, end;
  };

  MemoryWords& words(DataKind kind) { return words_[kernel_][static_cast<uint32_t>(kind)]; }

  void Cache(DataKind kind, uint64_t address, size_t bytes) {
    if (cache_) cache_->Access(kind, address, static_cast<uint32_t>(bytes));
  }

  void Written(uint64_t stream, uint64_t begin, uint64_t end) {
    for (WrittenRange& range : written_)
      if (range.stream == stream) {
        range.begin = std::min(range.begin, begin);
        range.end = std::max(range.end, end);
        return;
      }
    written_.push_back({stream, begin, end});
  }

  void EndPass() {
    for (const WrittenRange& range : written_) cache_->Invalidate(range.begin, range.end);
    written_.clear();
  }

  TextureCache* cache_;
  uint32_t kernel_ = 0;
  MemoryWords words_[kMostKernels][kDataKinds];
  StencilBytes stencil_[kMostKernels];
  std::vector<WrittenRange> written_;
};

}  // namespace quarry::laboratory
