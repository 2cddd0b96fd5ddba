#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

#include "common/engine/blocks/environment_pages.h"
#include "common/engine/integrators/path/emitter_tree.h"
#include "common/engine/integrators/path/environment_light.h"
#include "common/engine/integrators/path/sky_light.h"
#include "common/scene/shown/section_cut.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// The ways by which paths find lights: each vertex asks for one, and rays that go on meet them. One alone is
/// for tests.
enum class LightWays { kBoth, kAsked, kMet };
/// How a vertex chooses among emitters: by EmitterTree, or by power alone, wherever it is, for tests.
enum class EmitterChoice { kNear, kByPower };

/// The radius of the sphere that a light is; 0: it is none, or smaller than a millionth of the scene, which
/// is a point. Thread-safe.
float SphereRadius(const Light& light, const SceneMeta& scene);
/// The axis that points up, of a view or else of its scene: 1 for y, 2 for z. Thread-safe.
uint32_t UpAxisOf(const View& view, const SceneMeta& scene);

/// The lights of a view for mode `path`: suns with discs, points and spots, which may be spheres, rectangles,
/// the sky or the environment, and the scene's table of emitters. Emitters that the view hides, colours or
/// cuts off are left out. A vertex asks for one light, which it chooses by power and evenly, by halves; paths
/// meet discs, spheres, rectangles and the sky too. Radiance is linear RGB, densities are by solid angle.
/// Immutable, so thread-safe. The same bits on all machines.
/// Memory: 168 bytes an emitter, 28 more with a map.
class PathLights {
 public:
  /// `view` is normalized. `environment`: the view's.
  PathLights(const View& view, const Catalog& scene, LightWays ways = LightWays::kBoth,
             const EnvironmentPages& environment = {}, EmitterChoice choice = EmitterChoice::kNear);
  PathLights(const PathLights&) = delete;

  bool empty() const { return entries_.empty(); }
  /// Whether paths can find one of the lights, emitters apart.
  bool can_be_met() const { return can_be_met_; }

  struct Sample {
    glm::vec3 direction{0};
    float distance = 0;
    glm::vec3 light{0};   ///< radiance over the density; of a point, irradiance over the chance
    float density = 0;    ///< with which the direction is chosen; 0: of a point, which paths cannot find
    glm::vec3 normal{0};  ///< of an emitter, on the side of the position; 0: nothing is there to be hit
    /// Of the environment: `light` lacks the factor of its radiance.
    uint32_t texel = EnvironmentLight::kNoTexel;
    /// Of an emitter with a map, its number for PlaceInMap(): `light` lacks the factor of its radiance.
    uint32_t mapped = kNoIndex;
  };
  /// The share of a light that a vertex has asked for, when its BSDF finds the direction with `met`; and that
  /// of a light that a ray has met, when a vertex asks for it with `asked`. Either is 0 where that way does
  /// not find the light. Source: Veach 1997, chapter 9 (the power heuristic).
  float AskedShare(float asked, float met) const;
  float MetShare(float met, float asked) const;

  /// Where light is asked for: a position, and the unit normal of the side from which it can come; 0: both.
  struct Vertex {
    glm::vec3 position{0}, side{0};
  };
  /// A light as seen from a vertex. `choice` (of the light, and among emitters), `u`: in [0, 1)^2, each
  /// number a multiple of 2^-24. A `light` of 0: none shines there. Requires: not empty().
  Sample Toward(const Vertex& vertex, const glm::vec2& choice, const glm::vec2& u) const;
  /// The place in the map of an emitter's material that Toward() has found with `u`.
  struct MapPlace {
    uint32_t material;
    glm::vec2 uv;
  };
  MapPlace PlaceInMap(uint32_t mapped, const glm::vec2& u) const;
  /// The density with which Toward() finds a point of a triangle at this distance from the vertex, where
  /// `cosine` is that between the ray and the triangle's normal. 0: the triangle is not in the table.
  float EmitterDensity(uint32_t triangle, const Vertex& vertex, float distance, float cosine) const;

  /// The light of rectangles and spheres that a ray meets between `begin` and `end` (units: t of a unit
  /// direction), and that of suns' discs and of the sky behind all. The eye sees discs, and the sky of an
  /// atmosphere; other skies are light, not a background. `density`: with which the ray was chosen; each
  /// light is weighed against its own choice by the power heuristic. 0: it could not be chosen by lights.
  glm::vec3 OnTheWay(const glm::vec3& origin, const glm::vec3& direction, float begin, float end,
                     float density) const;
  glm::vec3 Discs(const glm::vec3& direction, float density) const;
  glm::vec3 OfSky(const glm::vec3& direction, float density) const;
  /// Whether the eye sees the sky behind the scene.
  bool sky_is_seen() const { return sky_ && sky_->is_seen(); }
  /// The environment, or null; and the share of its radiance that a ray of this density has which meets it.
  const EnvironmentLight* environment() const { return environment_ ? &*environment_ : nullptr; }
  float EnvironmentShare(uint32_t texel, float density) const {
    return density > 0 ? MetShare(density, environment_->Density(texel) * environment_chance_) : 1.0f;
  }

 private:
  struct Entry {
    const Light* light = nullptr;  ///< null: the sky, the environment, or the emitters
    bool emitters = false;
    float chance = 0;
    float disc_density = 0;    ///< of a sun's disc: 1 over its solid angle; 0: there is none
    float cap = 0, sine2 = 0;  ///< 1 - the cosine of its edge, and the square of the sine
    glm::vec3 disc{0};         ///< its radiance
    glm::vec3 front{0};        ///< of a rectangle: unit normal
    float area = 0;
    glm::vec3 sphere{0};  ///< of a point with a radius: its radiance, without a cone
  };
  /// An emitter of the table.
  struct Shining {
    uint32_t triangle = 0;
    glm::vec3 corner{0}, sides[2], normal{0}, radiance{0};
    float area = 0;
    uint32_t mapped = kNoIndex;  ///< its number among those with a map
  };
  /// The map of an emitter, and its corners there.
  struct Mapped {
    uint32_t material = 0;
    glm::vec2 uvs[3];
  };
  static_assert(sizeof(Shining) == 72 && sizeof(Mapped) == 28, "the README states the memory");
  static Entry EntryOf(const Light& light);
  double TakeEmitters(const View& view, const Catalog& scene, EmitterChoice choice);
  void ShareChances(const std::vector<double>& powers);
  Sample TowardEmitter(const Vertex& vertex, double choice, const glm::vec2& u) const;
  static Sample TowardRectangle(const Entry& entry, const glm::vec3& position, const glm::vec2& u);
  static Sample TowardDisc(const Entry& entry, const glm::vec2& u);
  static Sample TowardSphere(const Entry& entry, const glm::vec3& position, const glm::vec2& u);
  glm::vec3 OfRectangle(const Entry& entry, const glm::vec3& origin, const glm::vec3& direction, float begin,
                        float end, float density) const;
  glm::vec3 OfSphere(const Entry& entry, const glm::vec3& origin, const glm::vec3& direction, float begin,
                     float end, float density) const;

  std::vector<Light> lights_;
  std::optional<SkyLight> sky_;
  std::optional<EnvironmentLight> environment_;
  float environment_chance_ = 0;
  std::vector<Entry> entries_;
  std::vector<uint32_t> chosen_below_;  ///< by entry: the first number, of 2^24, that chooses a later one
  std::vector<Shining> shining_;        ///< by ascending triangle
  std::vector<Mapped> mapped_;
  EmitterTree tree_;           ///< of these
  float emitters_chance_ = 0;  ///< that Toward() asks one of these
  SectionCut section_;         ///< points that it cuts off do not shine
  bool can_be_met_ = false;
  const LightWays ways_;
};

}  // namespace quarry
