#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <utility>

namespace quarry {

/// `bytes` in whole pages of memory.
inline constexpr size_t WholeMemoryPages(size_t bytes) {
  constexpr size_t kPage = 4096;
  return (bytes + kPage - 1) / kPage * kPage;
}

class PageSlabs;

/// Memory of whole pages, mapped from the system and unmapped when destroyed, or a unit of PageSlabs. The
/// heap would keep an evicted block's pages; this returns them. Movable, not thread-safe. Units: bytes.
class PageBuffer {
 public:
  PageBuffer() = default;
  /// Maps `bytes`, resident at once. Returns: nothing when the system has no memory.
  static std::optional<PageBuffer> TryGet(size_t bytes);
  /// Maps `bytes` that become resident when they are written. Returns: nothing when the system has no memory.
  static std::optional<PageBuffer> TryReserve(size_t bytes);
  PageBuffer(PageBuffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)),
        size_(std::exchange(other.size_, 0)),
        mapped_(std::exchange(other.mapped_, 0)),
        home_(std::exchange(other.home_, nullptr)) {}
  PageBuffer& operator=(PageBuffer&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(mapped_, other.mapped_);
    std::swap(home_, other.home_);
    return *this;
  }
  ~PageBuffer();
  std::span<std::byte> bytes() const { return {data_, size_}; }
  /// Bytes of all its pages.
  size_t mapped() const { return is_unit() ? WholeMemoryPages(size_) : mapped_; }
  /// Bytes of the pages that bytes() does not reach.
  size_t slack() const { return mapped() - WholeMemoryPages(size_); }
  /// Changes the size; the address may change and the content is lost. Keeps the pages that both sizes need,
  /// since getting a page costs about as much time as decoding into it. A buffer whose slack is then at most
  /// `most_slack` stays mapped as it is.
  /// Returns: false when the system has no memory, or a unit of slabs has another number of pages; nothing
  /// has changed then.
  [[nodiscard]] bool Resize(size_t bytes, size_t most_slack = 0);
  /// Cuts off the pages of the first `bytes` bytes. Requires: the buffer has as many pages, and is no unit.
  PageBuffer TakeFront(size_t bytes);
  bool is_unit() const { return home_ != nullptr; }

 private:
  friend class PageSlabs;
  std::byte* data_ = nullptr;
  size_t size_ = 0;
  size_t mapped_ = 0;  ///< in whole pages; of a unit not known
  PageSlabs* home_ = nullptr;
};

}  // namespace quarry
