#include "common/voxel/store_names.h"

#include <algorithm>
#include <cstring>
#include <span>
#include <string_view>
#include <utility>

namespace quarry {

Result<std::span<const std::byte>> StoreNames::From(Window& window, uint64_t at) const {
  if (at < window.begin || at >= window.begin + window.bytes.size()) {
    const uint64_t begin = at / kWindowBytes * kWindowBytes;
    Bytes bytes = std::exchange(window.bytes, {});  // none, however this ends
    bytes.resize(std::min(kWindowBytes, window.place.size - begin));
    QUARRY_TRY(file_.ReadAt(window.place.offset + begin, bytes));
    window.bytes = std::move(bytes);
    window.begin = begin;
  }
  return std::span<const std::byte>(window.bytes).subspan(at - window.begin);
}

Result<std::string> StoreNames::Text(uint32_t offset) const {
  std::string name;
  for (uint64_t at = offset; at < strings_.place.size && name.size() < kMostNameBytes;) {
    QUARRY_ASSIGN(const std::span<const std::byte> bytes, From(strings_, at));
    const std::string_view text = AsText(bytes).substr(0, kMostNameBytes - name.size());
    const size_t end = text.find('\0');
    name.append(text.substr(0, end));
    if (end != std::string_view::npos) break;
    at += text.size();
  }
  return name;
}

Result<std::string> StoreNames::At(uint32_t offset) const {
  const std::lock_guard lock(mutex_);
  return Text(offset);
}

Result<std::string> StoreNames::Part(uint32_t part) const {
  if (part >= part_count()) return std::string();
  const std::lock_guard lock(mutex_);
  // Windows begin at multiples of their size, so that no offset lies across two.
  QUARRY_ASSIGN(const std::span<const std::byte> bytes, From(parts_, uint64_t{part} * sizeof(uint32_t)));
  uint32_t offset = 0;
  std::memcpy(&offset, bytes.data(), sizeof offset);
  return Text(offset);
}

}  // namespace quarry
