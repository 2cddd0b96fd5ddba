#include "common/engine/integrators/make_integrator.h"

#include "common/engine/integrators/ambient_occlusion.h"
#include "common/engine/integrators/direct.h"
#include "common/engine/integrators/path/path_tracer.h"
#include "common/engine/integrators/raycast.h"
#include "common/engine/integrators/whitted.h"

namespace quarry {

std::shared_ptr<const Integrator> MakeIntegrator(const View& view, const Catalog& scene,
                                                 const EnvironmentPages& environment) {
  switch (view.mode) {
    case RenderMode::kRaycast:
      return std::make_shared<const Raycast>();
    case RenderMode::kShadow:
      return std::make_shared<const Direct>(view);
    case RenderMode::kWhitted:
      return std::make_shared<const Whitted>(view);
    case RenderMode::kPath:
      return std::make_shared<const PathTracer>(view, scene, LightWays::kBoth, environment);
    case RenderMode::kVoxels:
      return std::make_shared<const VoxelColors>();
    case RenderMode::kAo:
      break;
  }
  return std::make_shared<const AmbientOcclusion>(view, scene.meta);
}

}  // namespace quarry
