#pragma once

#include <glm/vec3.hpp>
#include <random>
#include <vector>

#include "common/scene/material.h"

// Surfaces of the independent path tracer, in double: the physics that deploy/PICTURES.md and path_bsdf.h
// state, written down once more. Nothing here includes the engine's shading. Directions are unit vectors that
// leave the surface. Immutable where not stated otherwise, so thread-safe.

namespace quarry::test {

/// A source of numbers in [0, 1). Not thread-safe.
class Numbers {
 public:
  explicit Numbers(uint64_t seed) : random_(seed) {}
  double Next() { return static_cast<double>(random_() >> 11) * 0x1p-53; }

 private:
  std::mt19937_64 random_;
};

/// The reflected share of a smooth boundary, by Fresnel's equations for the two waves. `cosine`: between ray
/// and normal, in [0, 1]. `index`: of the medium behind over that of the medium before.
double BoundaryShare(double cosine, double index);

/// The shares of light that a layer of GGX facets sends back, by the direction that it is seen from. Each
/// node is an integral over the facets by the midpoint rule.
class LayerShares {
 public:
  /// `roughness`: the square root of GGX's width. `index`: of a boundary, which facets are.
  LayerShares(double roughness, double index);

  /// The share if facets reflect all light.
  double OfMirrors(double cosine) const { return Between(mirrors_, cosine); }
  /// The share if facets reflect as the boundary does.
  double OfBoundary(double cosine) const { return Between(boundary_, cosine); }

 private:
  static double Between(const std::vector<double>& nodes, double cosine);
  std::vector<double> mirrors_, boundary_;
};

/// The place where a ray meets a surface, with its frame.
struct Meeting {
  glm::dvec3 position{0};
  glm::dvec3 side{0};    ///< geometric normal toward the viewer
  glm::dvec3 normal{0};  ///< shading normal toward the viewer
  glm::dvec3 color{1};   ///< of vertices
  glm::dvec3 view{0};    ///< toward the viewer
  bool entering = true;  ///< whether the viewer is on the outer side, by the winding
};

/// The mirrored viewer: by the shading normal, on the viewer's side of the triangle.
glm::dvec3 MirroredView(const Meeting& at);

/// The part of a surface that is neither hole nor glass: metal, and a matt body under a clear layer.
class OpaqueSurface {
 public:
  OpaqueSurface(const Material& material, const LayerShares& shares, const Meeting& at);

  /// The scattered share of the light from a direction: the BSDF times the cosine. Without that of a mirror.
  glm::dvec3 Scattered(const glm::dvec3& light) const;
  /// The density, by solid angle, with which Next() finds a direction.
  double Density(const glm::dvec3& light) const;

  struct Step {
    glm::dvec3 direction{0};
    glm::dvec3 weight{0};  ///< of the radiance from there
    double density = 0;    ///< 0: a mirror's
  };
  /// A direction for the path: even odds between the body, by the cosine, and the layer, by the distribution
  /// of facets. A surface without one of these always takes the other.
  Step Next(Numbers& numbers) const;

 private:
  double HalfDensity(const glm::dvec3& half) const;
  glm::dvec3 Facets(double cosine) const;
  glm::dvec3 ToWorld(double x, double y, double z) const { return across_ * x + along_ * y + at_.normal * z; }

  Meeting at_;
  glm::dvec3 across_, along_;
  double width_, index_, view_cosine_;
  bool is_mirror_;
  glm::dvec3 metal_, metal_edge_, layer_, again_, body_;
  double layer_odds_;
};

}  // namespace quarry::test
