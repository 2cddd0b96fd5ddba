#pragma once

#include <cstdint>

#include "common/engine/integrators/path/path_lights.h"
#include "common/engine/packet_work.h"

namespace quarry {

/// Adds the radiance of the texels of lights to the paths of `lanes`: of the environment, where their rays
/// have come to it, or of the emitter that they have asked. Returns: the lanes that wait for a page, which
/// are parked.
uint64_t LookUpLights(PacketWork& work, uint64_t lanes, const PathLights& lights);

/// Two numbers in [0, 1) for the texel of a light that a path sees, the same on all machines.
glm::vec2 AsideOfTexel(const PacketWork& work, uint32_t lane);

}  // namespace quarry
