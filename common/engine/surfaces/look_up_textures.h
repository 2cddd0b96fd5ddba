#pragma once

#include "common/engine/packet_work.h"

namespace quarry {

/// Makes the texture frames of surfaces whose attributes are there. Returns: the lanes that have textures to
/// look up. Requires: the view looks textures up.
uint64_t StartLookups(PacketWork& work, uint64_t lanes);

/// Looks textures up, for each sample one after the other: moves lanes from kTextures to kShade. Returns: the
/// lanes that wait for a page.
uint64_t LookUpTextures(PacketWork& work, uint64_t lanes);

}  // namespace quarry
