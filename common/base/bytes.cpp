#include "common/base/bytes.h"

#include <xxhash.h>

namespace quarry {

uint64_t Checksum(std::span<const std::byte> bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

uint64_t Checksum(std::span<const std::byte> first, std::span<const std::byte> second) {
  if (second.empty()) return Checksum(first);
  if (first.empty()) return Checksum(second);
  XXH3_state_t* const state = XXH3_createState();
  XXH3_64bits_reset(state);
  XXH3_64bits_update(state, first.data(), first.size());
  XXH3_64bits_update(state, second.data(), second.size());
  const uint64_t checksum = XXH3_64bits_digest(state);
  XXH3_freeState(state);
  return checksum;
}

}  // namespace quarry
