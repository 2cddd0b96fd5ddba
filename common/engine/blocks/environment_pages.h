#pragma once

#include <cstdint>

#include "common/voxel/catalog.h"

namespace quarry {

/// An environment whose pages a cache holds, and its number there.
struct EnvironmentPages {
  const Catalog* catalog = nullptr;  ///< null: none
  uint32_t number = 0;
};

}  // namespace quarry
