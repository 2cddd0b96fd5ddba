#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/trace/kernel_parts.h"
#include "tests/laboratory/machine/picture.h"

namespace quarry::laboratory {

/// The nearest hits of the eye rays of `pixels`, by rasterising: each triangle is tested at the pixels that
/// its projection may cover, and a depth buffer keeps the nearest. The test is the one of rays, so that the
/// hits are theirs to the last bit. Stands for the first pass of the shadow caster, which graphics hardware
/// draws. Shapes: one per element of `pixels`. Thread-safe. Source: Purcell et al. 2002, section 3.1.4.
std::vector<HitState> Rasterize(const Picture& picture, std::span<const uint32_t> pixels, uint32_t sample);

/// Memory of Rasterize() for each pixel.
inline constexpr uint64_t kRasterBytes =
    sizeof(uint32_t) + sizeof(RayFrame<ScalarLane>) + sizeof(Hit) + sizeof(HitState);

}  // namespace quarry::laboratory
