#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>

#include "common/math/host_device.h"
#include "common/math/next_float.h"

namespace quarry {

inline constexpr float kInfinity = std::numeric_limits<float>::infinity();
inline constexpr uint32_t kNoTriangle = 0xFFFFFFFFu;
inline constexpr uint32_t kNoVoxel = 0xFFFFFFFFu;
/// The instance of triangles that are the scene's own. No store has others yet.
inline constexpr uint32_t kNoInstance = 0xFFFFFFFFu;

/// The nearest hit known so far, or none (`triangle == kNoTriangle`).
struct Hit {
  float t = kInfinity;              ///< multiples of |direction|
  uint32_t triangle = kNoTriangle;  ///< scene-wide triangle id
  float b1 = 0, b2 = 0;             ///< barycentric weights of the second and third vertex
  uint32_t voxel = kNoVoxel;        ///< the voxel in which the triangle was found
  uint32_t local = 0;               ///< the triangle's index in that voxel
  uint32_t instance = kNoInstance;  ///< of the part that holds the triangle
};

/// Limit of a ray origin's coordinates, in multiples of the scene's largest coordinate in magnitude.
inline constexpr float kReach = 2;

/// The t from which a ray finds all hits at `after_t` and beyond, whatever the leaf in which the present hit
/// was found. Each triangle that the ray hits at some t is a reference of the leaf whose cell holds that t,
/// and at a border of two cells of both (ReferencePadding). So a ray need not return to its start. It resumes
/// one step before `after_t`: kernels enter a cell only before the ray's nearest hit, and a further hit at
/// `after_t` must not end the ray before it has visited all voxels there.
QUARRY_HOST_DEVICE inline float ResumeBefore(float after_t) { return NextBelow(after_t); }

/// A ray under way. A suspended ray resumes from these values alone.
/// Units: positions in scene units; t in multiples of |direction|.
/// Requires: |direction| about 1; the origin's coordinates at most kReach times the scene's largest
/// (PrimaryRay and shading ensure it; ReferencePadding depends on it).
struct Ray {
  glm::vec3 origin{0};
  float t = 0;  ///< reached so far: all hits before it have been found
  glm::vec3 direction{0, 0, 1};
  float t_max = kInfinity;  ///< hits must lie before it
  Hit hit;
  uint32_t chain = 0;  ///< the voxel of a chain to continue with at `t`; 0: the first
  /// Exclusive lower bound: only hits after (after_t, after_id) count, in the order of (t, id). 0: no bound,
  /// since all hits lie at t > 0.
  float after_t = 0;
  uint32_t after_id = 0;

  /// Passes the present hit: the ray goes on, in any kernel, to the hit that follows in the order of (t, id).
  /// Requires: the ray has been traced to its end and has a hit.
  void GoOnAfterHit() {
    after_t = hit.t;
    after_id = hit.triangle;
    t = ResumeBefore(after_t);
    chain = 0;
    hit = {};
  }
};

}  // namespace quarry
