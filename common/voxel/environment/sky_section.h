#pragma once

#include <cstddef>
#include <span>

#include "common/base/status.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Decodes the section ENVR of an environment's catalog. Requires: `catalog` has its voxels and textures.
/// Errors: SkyTable::Decode(); a catalog that is none of an environment.
Status DecodeSky(std::span<const std::byte> bytes, Catalog& catalog);

}  // namespace quarry
