#pragma once

#include "common/api/quarry.h"
#include "common/scene/ray_query.h"
#include "common/voxel/catalog.h"

namespace quarry::api {

/// A caller's rays from number `base` on, as queries to a scene. The offset of the store is subtracted from
/// origins in double. tnear and tfar, lengths of the ray's direction, become distances. RayOfQuery() then
/// makes the one ray of floats. Thread-safe.
class CallerRays final : public RayArray {
 public:
  /// Requires: CheckArrays(); `rays` and its arrays outlive this and do not change.
  CallerRays(const quarry_rays& rays, const SceneMeta& scene, size_t base);

  void Read(size_t first, std::span<RayQuery> out) const override;
  /// Errors (usage): the sentence names the array and the index.
  Status Check(size_t first, size_t count) const override;
  /// The length of a unit of t of a query, in scene units: that of its direction. Requires: a query that
  /// Read() made.
  static double UnitOf(const RayQuery& query);

 private:
  template <class Number>
  void ReadAs(size_t first, std::span<RayQuery> out) const;
  Status CheckOne(size_t index, const RayQuery& ray) const;

  const quarry_rays& rays_;
  const glm::dvec3 offset_;
  const size_t base_;
  ptrdiff_t stride_, t_stride_;
};

/// Checks what does not depend on single rays. Errors (usage): `size` of another release, an array that is
/// missing, an unknown type or flag, more rays than memory has room for.
Status CheckArrays(const quarry_rays* rays);

}  // namespace quarry::api
