#pragma once

#include <cstdint>

#include "common/engine/packet_work.h"

namespace quarry {

/// Resets the lookups of `lanes` after a new hit. Call it before stage kTint.
void BeginTints(PacketWork& work, uint64_t lanes);

/// Looks up the textures that tint the light rays of `lanes` at the panes that they have hit, from texels
/// that are not blurred. Lanes without such a texture are done at once. Returns: the lanes that wait for a
/// block, which are parked. A lane that waits keeps what it has found, so that it needs one block at a time.
uint64_t LookUpTints(PacketWork& work, uint64_t lanes);

/// The properties of the pane of material number `material` that the lane's light ray has hit, with the tint
/// that was looked up.
SurfaceProperties PaneAt(const PacketWork& work, uint32_t lane, uint32_t material);

}  // namespace quarry
