#pragma once

#include "common/engine/packet_work.h"

namespace quarry {

/// Makes the surfaces of hits from their triangles: moves lanes from kSurface to kAttributes, or to kShade
/// where the voxel has none. Returns: the lanes that wait for their hot block.
uint64_t FindSurfaces(PacketWork& work, uint64_t lanes);

/// Adds normals, uv and colours: moves lanes from kAttributes to kTextures, or to kShade where no texture is
/// needed. Returns: the lanes that wait for their shading block.
uint64_t FindAttributes(PacketWork& work, uint64_t lanes);

}  // namespace quarry
