#pragma once

#include "common/kdtree/lane.h"
#include "common/kdtree/ray.h"
#include "common/math/host_device.h"

namespace quarry {

/// Values that traversal and the triangle test derive once from a ray: reciprocals of the direction, and the
/// shear that makes the ray the z axis of a space whose unit is the t of the ray.
/// Source: Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection", section 3.1.
template <class L>
struct RayFrame {
  using Float = typename L::Float;
  using Mask = typename L::Mask;
  Float origin[3];
  Float reciprocal[3];  ///< of the direction, components under 1e-18 replaced by 1e-18 of the same sign
  Float shift[3];       ///< see PlaneT
  Float shear_x, shear_y, scale_z;
  Mask z_is_x, z_is_y;  ///< the direction's largest axis; neither: z
};

/// The t at which rays meet the plane at `plane` (scene units) across `axis`. Every kernel finds the cells of
/// a ray by this arithmetic, at the top level and in voxels. It never decreases along a ray from plane to
/// plane, so all kernels agree to the last bit on the cell of a ray at a given t. A suspended ray therefore
/// continues in the voxel that it waited for, in any kernel.
template <class L>
QUARRY_HOST_DEVICE inline typename L::Float PlaneT(const RayFrame<L>& ray, typename L::Float plane,
                                                   int axis) {
  return L::Fma(plane, ray.reciprocal[axis], ray.shift[axis]);
}

/// Renames x, y, z so that z is the ray's largest axis. The renaming is cyclic: faces keep their side.
template <class L>
QUARRY_HOST_DEVICE inline void Rotate(const RayFrame<L>& frame, typename L::Float& x, typename L::Float& y,
                                      typename L::Float& z) {
  const auto x0 = x, y0 = y, z0 = z;
  x = L::Select(frame.z_is_x, y0, L::Select(frame.z_is_y, z0, x0));
  y = L::Select(frame.z_is_x, z0, L::Select(frame.z_is_y, x0, y0));
  z = L::Select(frame.z_is_x, x0, L::Select(frame.z_is_y, y0, z0));
}

/// A component of a direction, or 1e-18 with its sign where it is too small to divide by.
template <class L>
QUARRY_HOST_DEVICE inline typename L::Float Divisor(typename L::Float d) {
  const auto least = L::Set(1e-18f);
  return L::Select(L::Less(L::Abs(d), least), L::CopySign(least, d), d);
}

template <class L>
QUARRY_HOST_DEVICE inline RayFrame<L> MakeRayFrame(const typename L::Float (&origin)[3],
                                                   const typename L::Float (&direction)[3]) {
  using Float = typename L::Float;
  RayFrame<L> f;
  const Float one = L::Set(1.0f);
  for (int a = 0; a < 3; ++a) {
    f.origin[a] = origin[a];
    f.reciprocal[a] = one / Divisor<L>(direction[a]);
    f.shift[a] = L::Negate(origin[a] * f.reciprocal[a]);
  }
  const Float x = L::Abs(direction[0]), y = L::Abs(direction[1]), z = L::Abs(direction[2]);
  f.z_is_x = L::And(L::Less(y, x), L::Less(z, x));
  f.z_is_y = L::AndNot(f.z_is_x, L::AndNot(L::Less(y, x), L::Less(z, y)));
  Float kx = direction[0], ky = direction[1], kz = direction[2];
  Rotate(f, kx, ky, kz);
  f.shear_x = L::Negate(kx / kz);
  f.shear_y = L::Negate(ky / kz);
  f.scale_z = one / kz;
  return f;
}

QUARRY_HOST_DEVICE inline RayFrame<ScalarLane> MakeRayFrame(const Ray& ray) {
  const float origin[3] = {ray.origin.x, ray.origin.y, ray.origin.z};
  const float direction[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
  return MakeRayFrame<ScalarLane>(origin, direction);
}

/// Narrows [t_enter, t_exit] to the part between the planes of a box. `t_of(plane, axis)`: the t at which
/// rays meet a plane.
template <class L, class PlaneT>
QUARRY_HOST_DEVICE inline void ClipToSlabs(const float (&lower)[3], const float (&upper)[3], PlaneT t_of,
                                           typename L::Float& t_enter, typename L::Float& t_exit) {
  for (int a = 0; a < 3; ++a) {
    const auto t0 = t_of(lower[a], a);
    const auto t1 = t_of(upper[a], a);
    t_enter = L::Max(t_enter, L::Min(t0, t1));
    t_exit = L::Min(t_exit, L::Max(t0, t1));
  }
}

/// Narrows [t_enter, t_exit] to the part in a box; empty (t_enter > t_exit) for rays that miss. The padding
/// of the scene's box covers rounding.
template <class L>
QUARRY_HOST_DEVICE inline void ClipToBox(const RayFrame<L>& ray, const float (&lower)[3],
                                         const float (&upper)[3], typename L::Float& t_enter,
                                         typename L::Float& t_exit) {
  const auto t_of = [&](float plane, int a) { return PlaneT<L>(ray, L::Set(plane), a); };
  ClipToSlabs<L>(lower, upper, t_of, t_enter, t_exit);
}

/// The rays that come to a box between t_enter and t_exit.
template <class L>
QUARRY_HOST_DEVICE inline typename L::Mask Meets(const RayFrame<L>& ray, const float (&lower)[3],
                                                 const float (&upper)[3], typename L::Float t_enter,
                                                 typename L::Float t_exit) {
  ClipToBox<L>(ray, lower, upper, t_enter, t_exit);
  return L::LessEqual(t_enter, t_exit);
}

}  // namespace quarry
