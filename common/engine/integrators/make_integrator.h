#pragma once

#include <memory>

#include "common/engine/blocks/environment_pages.h"
#include "common/engine/integrators/integrator.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// The integrator of the view's mode: the one place that has a branch for each. Requires: the view is
/// normalized, and outlives the integrator; `environment` is the view's, in mode path.
std::shared_ptr<const Integrator> MakeIntegrator(const View& view, const Catalog& scene,
                                                 const EnvironmentPages& environment = {});

}  // namespace quarry
