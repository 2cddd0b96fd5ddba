#pragma once

#include <cstddef>
#include <span>

namespace quarry::fuzz {

/// Sets every checksum of a scene store, and the file's size in its header, to fit the bytes, so that readers
/// see a fuzzer's changes instead of a false checksum. Checksums of ranges outside the file stay.
void MendStore(std::span<std::byte> file);

}  // namespace quarry::fuzz
