#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/catalog.h"
#include "common/voxel/emitters/emitter.h"

namespace quarry {

inline constexpr size_t kEmitterBytes = 48, kMappedEmitterBytes = 84;

/// The sections EMIT and EMAP: emitters without a map of emission, and with one.
struct EmitterSections {
  Bytes plain, mapped;
};
/// Requires: at most kMostEmitters, by ascending triangle.
EmitterSections EncodeEmitters(std::span<const Emitter> emitters, const std::vector<Material>& materials);

/// The inverse of EncodeEmitters(). Requires: `catalog` has its facts and materials, with their textures.
/// Errors: another size; triangles that do not ascend, or that the scene does not have, or that come twice; a
/// material that does not shine, or belongs in the other section; corners that are not finite, or beyond
/// the scene's box; a triangle without area; a place in the map that is not finite; a mean radiance that is
/// no radiance.
Result<std::vector<Emitter>> DecodeEmitters(std::span<const std::byte> plain,
                                            std::span<const std::byte> mapped, const Catalog& catalog);

}  // namespace quarry
