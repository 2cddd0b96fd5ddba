#include "common/engine/integrators/path/path_numbers.h"

#include "common/engine/surfaces/for_lanes.h"
#include "common/math/sampling.h"

namespace quarry {

void PathNumbers::Draw(uint64_t seed, const SamplePacket& samples, uint64_t lanes) {
  for (uint32_t slot = 0; slot < kSlots; ++slot)
    ForLanes(lanes, [&](int i, bool meant) {
      const uint32_t dimension = samples.depth[i] * kDimensionsPerBounce + 2 * slot;
      const glm::vec2 u = SobolSample(seed, samples.image_pixel[i], samples.sample[i], dimension);
      Put(meant, i, u.x, x[slot]);
      Put(meant, i, u.y, y[slot]);
    });
}

}  // namespace quarry
