#pragma once

#include "common/voxel/catalog.h"
#include "tests/bench/rays/ray_sets.h"

namespace quarry::bench {

/// What rays are put in order by before they are traced: where they begin, along a Morton curve of 1,024
/// cells a side over the scene's box, or the signs and the largest axis of their directions; the first named
/// counts most.
enum class RayOrder { kPixels, kPlace, kOctant, kPlaceOctant, kOctantPlace };

/// Puts the active rays of `set` in another order, in full packets but for the last; rays with the same key
/// stay as they were among each other. `kPlaceOctant`: by octant within the cells of a grid of 16 a side. Of
/// a ray its origin and direction alone are kept.
void Reorder(RaySet& set, RayOrder order, const SceneMeta& meta);

}  // namespace quarry::bench
