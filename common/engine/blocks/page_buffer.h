#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <utility>

namespace quarry {

/// Whole pages straight from the system, given back at once when destroyed, so that evicting a block makes
/// room in fact and not only in the heap's books. Movable.
class PageBuffer {
 public:
  PageBuffer() = default;
  /// Nothing when the system has no such memory.
  static std::optional<PageBuffer> TryGet(size_t bytes);
  PageBuffer(PageBuffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  PageBuffer& operator=(PageBuffer&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~PageBuffer();
  std::span<std::byte> bytes() const { return {data_, size_}; }
  /// Makes it another size, perhaps elsewhere; its content is lost. Pages are kept as far as they are needed:
  /// getting them anew takes the system as long as decoding a block into them. False, and nothing has
  /// changed, when the system has no such memory.
  [[nodiscard]] bool Resize(size_t bytes);
  /// Cuts off memory for so many bytes in front: whole pages. Requires: it has as many pages.
  PageBuffer TakeFront(size_t bytes);

 private:
  std::byte* data_ = nullptr;
  size_t size_ = 0;
};

}  // namespace quarry
