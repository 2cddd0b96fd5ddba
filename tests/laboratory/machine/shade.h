#pragma once

#include <algorithm>
#include <cmath>

#include "common/engine/integrators/bounce.h"
#include "common/engine/integrators/scatter.h"
#include "common/math/next_float.h"
#include "common/math/sampling.h"
#include "tests/laboratory/machine/picture.h"
#include "tests/laboratory/machine/ray_state.h"

// The shade kernels of the four renderers, over one ray in registers: the colour of a hit, the light of a
// shadow ray, and the choice of the next ray. The functions of light and surfaces are the workers' own, so
// that pictures are the same bits. No recursion: rays carry their weight (Purcell et al. 2002,
// section 3.1.4).

namespace quarry::laboratory {

/// Shades one ray. `Pending` keeps rays for later: Push(const PendingRay&) and Pop(). Not thread-safe.
template <class A, class M, class Pending>
class Shader {
 public:
  Shader(const Picture& picture, M& memory, uint32_t pixel, uint32_t sample, RayRegisters<A>& r,
         Pending& pending, PixelSum& sum)
      : picture_(picture),
        memory_(memory),
        pixel_(pixel),
        sample_(sample),
        r_(r),
        pending_(pending),
        sum_(sum) {}

  /// Takes up the nearest hit of a ray, or that there is none.
  void Color() {
    if (r_.hit.triangle == kNoTriangle) {
      Add(view().background);
      return Next();
    }
    Material material;
    const Surface surface = SurfaceOf(material);
    if (picture_.renderer == Renderer::kPath) return Scattered(material, surface);
    const ScatterProperties scatter = Scattering(material);
    if (picture_.renderer == Renderer::kRaycast) {
      Add(UnderHeadlight(scatter, surface));
      return Next();
    }
    Add(UnderAmbient(scatter, view().ambient, surface));
    r_.lit.surface = surface;
    r_.lit.next_light = 0;
    NextLight();
  }

  /// Takes up a shadow ray that has been traced.
  void Shadow() {
    const bool free = r_.hit.triangle == kNoTriangle;
    if (r_.stencil.kind() == RayKind::kAny) {
      if (!free || !r_.stencil.met_see_through()) {
        if (free) Add(r_.lit.light);
        return NextLight();
      }
      r_.bound = {0, 0};
      r_.hit = {NextBelow(LightDistance()), 0, 0, kNoTriangle};
      r_.lit.passed = 0;
      r_.stencil = Stencil::Of(Stage::kSetup, RayKind::kPassing);
      return;
    }
    if (free) {
      Add(r_.lit.light);
      return NextLight();
    }
    if (!Tint()) return NextLight();
    r_.bound = {r_.hit.t, r_.hit.triangle};
    r_.hit = {NextBelow(LightDistance()), 0, 0, kNoTriangle};
    r_.stencil = Stencil::Of(Stage::kSetup, RayKind::kPassing);
  }

 private:
  const View& view() const { return picture_.context.view; }
  /// The scattering of a material in the picture's mode.
  ScatterProperties Scattering(const Material& material) const {
    return ScatterOf(material, picture_.renderer == Renderer::kWhitted ? DiffuseColor : BaseColor);
  }
  void Add(const glm::vec3& radiance) { sum_.Add(r_.path.weight * radiance); }

  /// The surface at the ray's hit, and its material.
  Surface SurfaceOf(Material& material) {
    const uint32_t t = r_.hit.triangle;
    glm::vec3 p[3];
    for (int c = 0; c < 3; ++c) {
      const Float3& at = memory_.Fetch(picture_.scene.corner(c), t);
      p[c] = {at.x, at.y, at.z};
    }
    const TriangleMaterial of = memory_.Fetch(picture_.scene.materials(), t);
    const glm::vec3 direction(r_.ray.direction[0], r_.ray.direction[1], r_.ray.direction[2]);
    Surface surface = SurfaceAt(p[0], p[1], p[2], r_.hit.b1, r_.hit.b2, direction);
    surface.material = of.material();
    if (of.has_attributes()) {
      const ShadingVertex* v = memory_.Fetch(picture_.scene.attributes(), t).vertices;
      AddAttributes(v[0], v[1], v[2], r_.hit.b1, r_.hit.b2, surface);
    }
    material = picture_.scene.catalog().materials[of.material()];
    return surface;
  }

  float LightDistance() const {
    return SampleLight(view().lights[r_.lit.next_light - 1], r_.lit.surface.position).distance;
  }

  /// Sends a shadow ray toward the next light that can shine on the surface; without one, goes on.
  void NextLight() {
    const Surface& surface = r_.lit.surface;
    const Material& material = picture_.scene.catalog().materials[surface.material];
    const ScatterProperties scatter = Scattering(material);
    const auto lights = static_cast<uint32_t>(view().lights.size());
    while (r_.lit.next_light < lights) {
      const LightSample sample = SampleLight(view().lights[r_.lit.next_light++], surface.position);
      r_.lit.light = Scatter(scatter, surface, sample);
      if (!(Largest(r_.lit.light) > 0)) continue;
      StartRay(surface, sample.direction, sample.distance, RayKind::kAny);
      return;
    }
    if (picture_.renderer == Renderer::kWhitted) Spawn(material, surface);
    if (picture_.renderer == Renderer::kPath) return Bounced(material, surface);
    Next();
  }

  void StartRay(const Surface& surface, const glm::vec3& direction, float t_max, RayKind kind) {
    const glm::vec3 origin =
        LeaveSurface(surface.position, surface.geometric_normal, direction, picture_.offset);
    for (int a = 0; a < 3; ++a) {
      r_.ray.origin[a] = origin[a];
      r_.ray.direction[a] = direction[a];
    }
    r_.hit = {NextBelow(t_max), 0, 0, kNoTriangle};
    r_.bound = {0, 0};
    r_.stencil = Stencil::Of(Stage::kSetup, kind);
  }

  /// Tints the shadow ray's light by the see-through surface that it has hit. Returns: whether light is left.
  bool Tint() {
    Material material;
    const uint32_t t = r_.hit.triangle;
    glm::vec3 p[3];
    for (int c = 0; c < 3; ++c) {
      const Float3& at = memory_.Fetch(picture_.scene.corner(c), t);
      p[c] = {at.x, at.y, at.z};
    }
    const glm::vec3 direction(r_.ray.direction[0], r_.ray.direction[1], r_.ray.direction[2]);
    const Surface passed = SurfaceAt(p[0], p[1], p[2], r_.hit.b1, r_.hit.b2, direction);
    material = picture_.scene.catalog().materials[memory_.Fetch(picture_.scene.materials(), t).material()];
    if (!LetsLightThrough(material)) return false;
    r_.lit.light *= PassedLight(material, glm::dot(passed.normal, passed.view));
    return ++r_.lit.passed <= kMostPassed && Largest(r_.lit.light) > 0;
  }

  /// Whitted: the reflected and the transmitted ray, for later.
  void Spawn(const Material& material, const Surface& surface) {
    if (!CanBounce(material) || r_.path.depth >= kMostBounces) return;
    const Bounces b = Bounce(material, surface);
    const auto push = [&](const glm::vec3& direction, const glm::vec3& share, uint32_t code) {
      const glm::vec3 weight = r_.path.weight * share;
      if (Largest(weight) < kLeastWeight) return;
      const glm::vec3 origin =
          LeaveSurface(surface.position, surface.geometric_normal, direction, picture_.offset);
      pending_.Push({{{origin.x, origin.y, origin.z}, {direction.x, direction.y, direction.z}},
                     {weight, code, r_.path.depth + 1}});
    };
    push(b.refract_direction, b.refract_weight, RefractedPath(r_.path.code));
    push(b.reflect_direction, b.reflect_weight, ReflectedPath(r_.path.code));
  }

  /// Path tracing: emission, then the lights, then Bounced().
  void Scattered(const Material& material, const Surface& surface) {
    Add(Emitted(Scattering(material), surface));
    r_.lit.surface = surface;
    r_.lit.next_light = 0;
    NextLight();
  }
  /// Path tracing: a diffuse bounce with a density by the cosine, so that the weight is the albedo alone.
  void Bounced(const Material& material, const Surface& surface) {
    if (r_.path.depth == kPathBounces) return Next();
    const glm::vec3 weight = r_.path.weight * (Scattering(material).albedo * surface.color);
    if (Largest(weight) < kLeastWeight) return Next();
    const glm::vec2 u = SobolSample(view().seed, pixel_, sample_,
                                    kDimensionsPerBounce * (r_.path.depth + 1) + kDirectionSlot);
    r_.path = {weight, ReflectedPath(r_.path.code), r_.path.depth + 1};
    StartRay(surface, CosineDirection(surface.normal, u), kInfinity, RayKind::kClosest);
  }

  /// The newest pending ray, or the end of the sample.
  void Next() {
    if (r_.pending == 0) {
      r_.stencil = r_.stencil.At(Stage::kDone);
      return;
    }
    const PendingRay next = pending_.Pop();
    r_.ray = next.ray;
    r_.path = next.path;
    r_.hit = {NextBelow(kInfinity), 0, 0, kNoTriangle};
    r_.bound = {0, 0};
    r_.stencil = Stencil::Of(Stage::kSetup, RayKind::kClosest);
  }

  const Picture& picture_;
  M& memory_;
  const uint32_t pixel_, sample_;
  RayRegisters<A>& r_;
  Pending& pending_;
  PixelSum& sum_;
};

}  // namespace quarry::laboratory
