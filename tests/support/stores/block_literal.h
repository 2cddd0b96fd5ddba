#pragma once

#include "common/voxel/block_key.h"

namespace quarry {

/// The block with number 5, written as 5_b.
constexpr BlockKey operator""_b(unsigned long long number) {
  return BlockKey::FromNumber(static_cast<uint32_t>(number));
}

}  // namespace quarry
