#pragma once

#include "common/voxel/catalog.h"
#include "tests/bench/rays/ray_sets.h"

namespace quarry::bench {

/// The key by which rays are sorted before they are traced. Place: the ray's origin, along a Morton curve of
/// 1,024 cells a side over the scene's box. Octant: the signs and the largest axis of the direction. The key
/// named first counts most.
enum class RayOrder { kPixels, kPlace, kOctant, kPlaceOctant, kOctantPlace };

/// Puts the active rays of `set` in another order, in full packets but for the last; rays with the same key
/// stay as they were among each other. `kPlaceOctant`: by octant within the cells of a grid of 16 a side. Of
/// a ray its origin and direction alone are kept.
void Reorder(RaySet& set, RayOrder order, const SceneMeta& meta);

}  // namespace quarry::bench
