#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <vector>

namespace quarry {

/// Numbers values by first appearance; values are equal if their bits are. Open addressing, at most two
/// thirds full. Requires: at most 65,535 values.
template <class T>
class Interner {
 public:
  explicit Interner(size_t most)
      : table_(std::bit_ceil(most + most / 2 + 2), kFree), shift_(64 - std::countr_zero(table_.size())) {}

  uint16_t Index(const T& value, std::vector<T>& values) {
    size_t at = HashOf(value) >> shift_;
    // Values are equal if their bits are: 0 and -0 are stored apart.
    // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
    while (table_[at] != kFree && std::memcmp(&values[table_[at]], &value, sizeof value) != 0)
      at = (at + 1) & (table_.size() - 1);
    if (table_[at] == kFree) {
      table_[at] = static_cast<uint16_t>(values.size());
      values.push_back(value);
    }
    return table_[at];
  }

 private:
  /// A sum of products, which need not wait for each other.
  static uint64_t HashOf(const T& value) {
    constexpr uint64_t kFactors[] = {0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB,
                                     0xA0761D6478BD642F, 0xE7037ED1A0B428DB, 0x8EBC6AF09C88C6E3,
                                     0x589965CC75374CC3, 0x1D8E4E27C47D124F};
    constexpr size_t kWords = (sizeof(T) + 7) / 8;
    uint64_t words[kWords] = {};
    std::memcpy(words, &value, sizeof value);
    uint64_t hash = 0;
    for (size_t i = 0; i < kWords; ++i)
      hash += (words[i] ^ words[i] >> 32) * (kFactors[i % std::size(kFactors)] + 2 * i);
    return (hash ^ hash >> 32) * kFactors[0];
  }

  static constexpr uint16_t kFree = 0xFFFF;
  std::vector<uint16_t> table_;  ///< indices into the values
  int shift_;                    ///< 64 minus the bits of a place in the table
};

}  // namespace quarry
