#include "tests/bench/pictures/embree_image.h"

#include <algorithm>
#include <atomic>
#include <thread>

#include "common/engine/integrators/bounce.h"
#include "common/engine/integrators/scatter.h"
#include "common/math/fixed_radiance.h"
#include "common/math/next_float.h"
#include "common/math/sampling.h"
#include "common/scene/camera.h"
#include "tests/support/rendering/make_surface.h"

namespace quarry::bench {
namespace {

/// One thread's view of the frame.
class Tracer {
 public:
  Tracer(const EmbreeScene& embree, const Catalog& catalog,
         const std::vector<std::unique_ptr<ResidentBlock>>& blocks, const View& view)
      : embree_(embree),
        catalog_(catalog),
        blocks_(blocks),
        view_(view),
        camera_(view.camera, view.width, view.height, catalog.meta.root_lower, catalog.meta.root_upper) {
    rtcInitIntersectContext(&context_);
    see_through_ = std::ranges::any_of(catalog.materials, LetsLightThrough);
  }

  void Pixel(uint32_t x, uint32_t y, float* out) {
    FixedRadiance radiance[3];
    for (uint32_t sample = 0; sample < view_.spp; ++sample) {
      const glm::vec2 at = PixelSample(view_.seed, y * view_.width + x, sample);
      const PrimaryRay primary = camera_.Shoot(x + static_cast<double>(at.x), y + static_cast<double>(at.y));
      if (primary.misses)
        Add(radiance, view_.background);
      else
        Follow(primary.origin, primary.direction, glm::vec3(1), 0, radiance);
    }
    for (int c = 0; c < 3; ++c) out[c] = radiance[c].Mean(view_.spp);
  }

 private:
  static void Add(FixedRadiance (&radiance)[3], const glm::vec3& value) {
    for (int c = 0; c < 3; ++c) radiance[c].Add(value[c]);
  }
  static RTCRay MakeRay(const glm::vec3& origin, const glm::vec3& direction, float t_max) {
    RTCRay ray{};
    ray.org_x = origin.x;
    ray.org_y = origin.y;
    ray.org_z = origin.z;
    ray.dir_x = direction.x;
    ray.dir_y = direction.y;
    ray.dir_z = direction.z;
    ray.tfar = t_max;
    ray.mask = 0xFFFFFFFFu;
    return ray;
  }

  void Follow(const glm::vec3& origin, const glm::vec3& direction, const glm::vec3& weight, uint32_t depth,
              FixedRadiance (&radiance)[3]) {
    RTCRayHit r{MakeRay(origin, direction, kInfinity), {}};
    r.hit.geomID = r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(embree_.scene(), &context_, &r);
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) return Add(radiance, weight * view_.background);
    const Surface s = SurfaceOf(r, direction);
    const Material& material = catalog_.materials[s.material];
    const ScatterProperties scatter =
        ScatterOf(material, view_.mode == RenderMode::kWhitted ? DiffuseColor : BaseColor);
    if (view_.mode == RenderMode::kRaycast) return Add(radiance, weight * UnderHeadlight(scatter, s));
    Add(radiance, weight * UnderAmbient(scatter, view_.ambient, s));
    for (const Light& l : view_.lights) {
      const LightSample light = SampleLight(l, s.position);
      const glm::vec3 scattered = Scatter(scatter, s, light);
      if (Largest(scattered) <= 0) continue;
      const glm::vec3 passed = PassedTo(Offset(s, light.direction), light);
      if (Largest(passed) > 0) Add(radiance, weight * scattered * passed);
    }
    if (view_.mode != RenderMode::kWhitted || depth >= kMostBounces) return;
    const Bounces b = Bounce(material, s);
    for (const auto& [way, share] :
         {std::pair{b.reflect_direction, b.reflect_weight}, std::pair{b.refract_direction, b.refract_weight}})
      if (Largest(weight * share) >= kLeastWeight)
        Follow(Offset(s, way), way, weight * share, depth + 1, radiance);
  }

  /// The share of the light that comes to `origin`. Shadow rays pass see-through surfaces as in the engine.
  glm::vec3 PassedTo(const glm::vec3& origin, const LightSample& light) {
    RTCRay shadow = MakeRay(origin, light.direction, light.distance);
    rtcOccluded1(embree_.scene(), &context_, &shadow);
    if (shadow.tfar >= 0) return glm::vec3(1);
    glm::vec3 passed(see_through_ ? 1 : 0);
    RTCRayHit r{MakeRay(origin, light.direction, light.distance), {}};
    for (uint32_t surfaces = 0; Largest(passed) > 0; ++surfaces) {
      r.ray.tfar = light.distance;
      r.hit.geomID = r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      rtcIntersect1(embree_.scene(), &context_, &r);
      if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) break;
      if (surfaces == kMostPassed) return glm::vec3(0);
      const Surface s = SurfaceOf(r, light.direction);
      passed *= PassedLight(catalog_.materials[s.material],
                            std::fabs(glm::dot(s.geometric_normal, light.direction)));
      r.ray.tnear = NextAbove(r.ray.tfar);
    }
    return passed;
  }

  Surface SurfaceOf(const RTCRayHit& r, const glm::vec3& direction) const {
    const EmbreeScene::Place& place = embree_.place(r.hit.primID);
    Hit hit;
    hit.t = r.ray.tfar;
    hit.triangle = place.triangle;
    hit.voxel = place.voxel;
    hit.local = place.local;
    hit.b1 = r.hit.u;
    hit.b2 = r.hit.v;
    Surface s =
        test::MakeSurface(blocks_[catalog_.NumberOf(BlockKey::Hot(place.voxel))]->hot, hit, direction);
    if (const auto& shading = blocks_[catalog_.NumberOf(BlockKey::Shading(place.voxel))])
      AddAttributes(shading->shading, hit, s);
    return s;
  }
  glm::vec3 Offset(const Surface& s, const glm::vec3& way) const {
    return LeaveSurface(s.position, s.geometric_normal, way, OffsetFromSurfaces(catalog_.meta.padding));
  }

  const EmbreeScene& embree_;
  const Catalog& catalog_;
  const std::vector<std::unique_ptr<ResidentBlock>>& blocks_;
  const View& view_;
  Camera camera_;
  bool see_through_;
  RTCIntersectContext context_;
};

}  // namespace

std::vector<float> EmbreeImage::Render(const View& view, unsigned threads) const {
  std::vector<float> image(size_t{3} * view.width * view.height);
  const uint32_t across = (view.width + kTileSize - 1) / kTileSize,
                 down = (view.height + kTileSize - 1) / kTileSize;
  std::atomic<uint32_t> next{0};
  std::vector<std::jthread> workers;
  for (unsigned i = 0; i < threads; ++i)
    workers.emplace_back([&] {
      Tracer tracer(embree_, catalog_, blocks_, view);
      for (uint32_t tile; (tile = next++) < across * down;) {
        const uint32_t x0 = tile % across * kTileSize, y0 = tile / across * kTileSize;
        for (uint32_t y = y0; y < std::min(y0 + kTileSize, view.height); ++y)
          for (uint32_t x = x0; x < std::min(x0 + kTileSize, view.width); ++x)
            tracer.Pixel(x, y, &image[size_t{3} * (y * view.width + x)]);
      }
    });
  workers.clear();
  return image;
}

}  // namespace quarry::bench
