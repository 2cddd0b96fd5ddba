#include "common/base/bytes.h"

#include <xxhash.h>

#include <new>

namespace quarry {

uint64_t Checksum(std::span<const std::byte> bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

namespace {

XXH3_state_t* HashState(void* state) { return static_cast<XXH3_state_t*>(state); }

}  // namespace

RunningChecksum::RunningChecksum() : state_(XXH3_createState()) {
  if (!state_) throw std::bad_alloc();
  XXH3_64bits_reset(HashState(state_));
}
RunningChecksum::~RunningChecksum() { XXH3_freeState(HashState(state_)); }
void RunningChecksum::Add(std::span<const std::byte> bytes) {
  if (!bytes.empty()) XXH3_64bits_update(HashState(state_), bytes.data(), bytes.size());
}
uint64_t RunningChecksum::value() const { return XXH3_64bits_digest(HashState(state_)); }

uint64_t Checksum(std::span<const std::byte> first, std::span<const std::byte> second) {
  if (second.empty()) return Checksum(first);
  if (first.empty()) return Checksum(second);
  RunningChecksum checksum;
  checksum.Add(first);
  checksum.Add(second);
  return checksum.value();
}

}  // namespace quarry
