#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace quarry {

static_assert(std::endian::native == std::endian::little,
              "stores and the protocol are little-endian, as is x86-64");

using Bytes = std::vector<std::byte>;

inline std::span<const std::byte> AsBytes(std::string_view text) {
  return {reinterpret_cast<const std::byte*>(text.data()), text.size()};
}
inline std::string_view AsText(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Appends values in stored (little-endian, unpadded) form.
class ByteWriter {
 public:
  template <class T>
  void Put(T value) {
    static_assert(std::is_arithmetic_v<T>);
    const size_t at = bytes_.size();
    bytes_.resize(at + sizeof value);
    std::memcpy(bytes_.data() + at, &value, sizeof value);
  }
  /// `values`: anything contiguous of trivially copyable elements.
  template <class Range>
  void PutArray(const Range& values) {
    const std::span elements(values);
    static_assert(std::is_trivially_copyable_v<typename decltype(elements)::element_type>);
    const auto raw = std::as_bytes(elements);
    bytes_.insert(bytes_.end(), raw.begin(), raw.end());
  }
  template <class V>
  void PutVec3(const V& v) {
    for (int a = 0; a < 3; ++a) Put(v[a]);
  }
  const Bytes& bytes() const { return bytes_; }
  Bytes Take() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

/// Takes values back out. Reading past the end yields zeros and makes ok() false for good: check once, before
/// believing anything.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <class T>
  T Get() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    if (!Ensure(sizeof value)) return value;
    std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return value;
  }
  template <class V>
  V GetVec3() {
    V v{};
    for (int a = 0; a < 3; ++a) v[a] = Get<typename V::value_type>();
    return v;
  }
  /// `count` values of T copied out; empty and not ok() when they are not there.
  template <class T>
  std::vector<T> GetArray(uint64_t count) {
    static_assert(std::is_trivially_copyable_v<T>);
    std::vector<T> values;
    if (count > remaining() / sizeof(T)) {
      ok_ = false;
      return values;
    }
    values.resize(count);
    if (count) std::memcpy(values.data(), bytes_.data() + at_, count * sizeof(T));
    at_ += count * sizeof(T);
    return values;
  }
  std::span<const std::byte> GetSpan(uint64_t size) {
    if (!Ensure(size)) return {};
    at_ += size;
    return bytes_.subspan(at_ - size, size);
  }
  uint64_t remaining() const { return bytes_.size() - at_; }
  bool ok() const { return ok_; }
  /// ok(), and nothing is left over.
  bool done() const { return ok_ && at_ == bytes_.size(); }

 private:
  bool Ensure(uint64_t size) {
    if (size > remaining()) ok_ = false;
    return ok_;
  }
  std::span<const std::byte> bytes_;
  size_t at_ = 0;
  bool ok_ = true;
};

/// XXH3, 64 bits: the checksum of every section and block.
uint64_t Checksum(std::span<const std::byte> bytes);
/// Of both, one after the other.
uint64_t Checksum(std::span<const std::byte> first, std::span<const std::byte> second);

}  // namespace quarry
