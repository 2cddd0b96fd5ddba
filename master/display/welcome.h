#pragma once

#include <cstdint>
#include <string>

#include "common/scene/scene_summary.h"
#include "common/scene/view_json.h"
#include "common/voxel/catalog.h"
#include "master/environments.h"

namespace quarry {

/// The first text to a viewer: the scene, the default view and the limits. See PROTOCOL.md. `name`: of the
/// scene, for people. `store`: its place for the master. Thread-safe.
std::string MakeWelcome(const std::string& name, const std::string& store, const SceneSummary& scene,
                        const Catalog& catalog, const Environments& environments,
                        const ViewDescription& defaults, uint64_t most_pixels);

}  // namespace quarry
