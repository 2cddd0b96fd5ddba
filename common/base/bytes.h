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

/// Appends values in the stored form: little-endian, without padding. Not thread-safe.
class ByteWriter {
 public:
  template <class T>
  void Put(T value) {
    static_assert(std::is_arithmetic_v<T>);
    const size_t at = bytes_.size();
    bytes_.resize(at + sizeof value);
    std::memcpy(bytes_.data() + at, &value, sizeof value);
  }
  /// Appends every element of `values`, a contiguous range of trivially copyable elements.
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

/// Reads values that ByteWriter wrote. Reading past the end returns zeros and makes ok() false for good:
/// check ok() or done() once, before using any value. Not thread-safe; `bytes` outlive the reader.
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
  /// Copies `count` values of T. Errors: empty and ok() false when fewer remain; allocates nothing then.
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
  /// A view of the next `size` bytes. Errors: empty and ok() false when fewer remain.
  std::span<const std::byte> GetSpan(uint64_t size) {
    if (!Ensure(size)) return {};
    at_ += size;
    return bytes_.subspan(at_ - size, size);
  }
  /// Bytes not read yet.
  uint64_t remaining() const { return bytes_.size() - at_; }
  bool ok() const { return ok_; }
  /// Whether every read succeeded and no byte remains.
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

/// The checksum of sections and blocks: XXH3, 64 bits. Thread-safe.
uint64_t Checksum(std::span<const std::byte> bytes);
/// The checksum of `first` and `second` joined.
uint64_t Checksum(std::span<const std::byte> first, std::span<const std::byte> second);

/// The checksum of bytes that come in pieces: after any Add()s, value() is Checksum() of all of them joined.
/// Not thread-safe.
class RunningChecksum {
 public:
  RunningChecksum();
  ~RunningChecksum();
  RunningChecksum(const RunningChecksum&) = delete;
  RunningChecksum& operator=(const RunningChecksum&) = delete;
  void Add(std::span<const std::byte> bytes);
  uint64_t value() const;

 private:
  void* state_;  // of XXH3
};

}  // namespace quarry
