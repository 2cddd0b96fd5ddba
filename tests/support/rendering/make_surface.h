#pragma once

#include "common/engine/surfaces/surface.h"

namespace quarry::test {

/// The surface at a hit, from the hot block: position, geometric normal, material, part.
inline Surface MakeSurface(const VoxelGeometry& voxel, const Hit& hit, const glm::vec3& direction) {
  Surface s = SurfaceAt(voxel.vertex(hit.local, 0), voxel.vertex(hit.local, 1), voxel.vertex(hit.local, 2),
                        hit.b1, hit.b2, direction);
  s.material = voxel.materials[hit.local];
  s.part = voxel.part(hit.local);
  return s;
}

}  // namespace quarry::test
