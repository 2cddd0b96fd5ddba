#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/catalog.h"
#include "common/voxel/emitters/emitter.h"

namespace quarry {

inline constexpr size_t kEmitterBytes = 48;

/// Encodes the section EMIT. Requires: at most kMostEmitters, by ascending triangle.
Bytes EncodeEmitters(std::span<const Emitter> emitters);

/// The inverse of EncodeEmitters(). Requires: `catalog` has its facts and materials.
/// Errors: another size; triangles that do not ascend, or that the scene does not have; a material that does
/// not shine; corners that are not finite, or beyond the scene's box; a triangle without area.
Result<std::vector<Emitter>> DecodeEmitters(std::span<const std::byte> bytes, const Catalog& catalog);

}  // namespace quarry
