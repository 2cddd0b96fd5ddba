#pragma once

#include <cstddef>
#include <span>

namespace quarry::fuzz {

/// Makes every checksum of a scene store right for the bytes that it has, and the file's size, so that a
/// fuzzer's changes are looked at for what they say. What lies nowhere in the file is left as it is.
void MendStore(std::span<std::byte> file);

}  // namespace quarry::fuzz
