#pragma once

#include <map>
#include <utility>
#include <vector>

#include "common/scene/view.h"
#include "tests/reference/recursive_model.h"

namespace quarry::test {

/// A path tracer for mode `path` to be compared with: recursive, in double, with its own lights, surfaces and
/// random numbers. A vertex asks one light, each kind of light with the same odds, and follows one direction;
/// the two are weighed by the balance heuristic. All paths have view.bounces bounces and a last ray, which
/// finds lights only. Left out: textures, points, spots and suns without a disc, clear skies,
/// unlit surfaces, sections, hidden and coloured parts, orthographic cameras. Thread-safe.
class RecursiveTracer {
 public:
  /// `view` is normalized. `model` and `view` outlive this.
  RecursiveTracer(const RecursiveModel& model, const View& view);

  /// The radiance of each pixel of the view: the mean of side * side samples, one in each cell of a grid
  /// within the pixel. Two threads. The same seed gives the same picture.
  std::vector<glm::dvec3> Picture(uint64_t seed, int side) const;

 private:
  /// A ray of a path.
  struct Way {
    glm::dvec3 origin, direction;
    int bounce;        ///< vertices before it
    double density;    ///< by solid angle, with which it was chosen; 0: of the eye, of a mirror or of glass
    double since = 0;  ///< distance from the vertex to `origin`, where the ray has passed surfaces
  };
  struct Shining {
    size_t triangle;
    double area_below;  ///< of these and all before
  };
  /// A point of a light, as a vertex sees it.
  struct Asked {
    glm::dvec3 direction{0}, radiance{0};
    double distance = 0, density = 0;
    glm::dvec3 normal{0};  ///< of a triangle, toward the vertex
  };
  /// The shares of a surface that let rays straight through.
  struct Through {
    double hole, pane, glass;  ///< `glass`: the share at which rays are mirrored or refracted
    glm::dvec3 tint;           ///< of panes
  };

  glm::dvec3 Radiance(const Way& way, Numbers& numbers) const;
  glm::dvec3 Scattered(const Way& way, const Meeting& at, const Material& material, Numbers& numbers) const;
  glm::dvec3 ByGlass(const Way& way, const Meeting& at, const Material& material, double length,
                     Numbers& numbers) const;
  glm::dvec3 ByLights(const Meeting& at, const OpaqueSurface& surface, Numbers& numbers) const;
  Asked Ask(const glm::dvec3& position, Numbers& numbers) const;
  Asked AskTriangle(const glm::dvec3& position, Numbers& numbers) const;
  glm::dvec3 Unhidden(const Meeting& at, const Asked& asked) const;
  glm::dvec3 Rectangles(const Way& way, double length) const;
  glm::dvec3 Behind(const Way& way) const;
  double Met(double density, double asked) const;
  Through ThroughOf(const Material& material, const Meeting& at) const;
  glm::dvec3 Leaving(const Meeting& at, const glm::dvec3& direction) const;
  void RowOf(int y, uint64_t seed, int side, std::vector<glm::dvec3>& picture) const;

  const RecursiveModel& model_;
  const View& view_;
  std::vector<LayerShares> shares_;                      ///< see shares_of_
  std::map<std::pair<float, float>, size_t> shares_of_;  ///< by roughness and index
  std::vector<Shining> shining_;
  std::vector<double> density_of_;  ///< of points of triangles, by area; 0: the triangle is not asked
  double odds_ = 0;                 ///< of each kind of light
};

}  // namespace quarry::test
