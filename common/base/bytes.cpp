#include "common/base/bytes.h"

#include <xxhash.h>

namespace quarry {

uint64_t Checksum(std::span<const std::byte> bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

}  // namespace quarry
