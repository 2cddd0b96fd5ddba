#pragma once

#include "scenes/mesh_writer.h"

namespace quarry::scenes {

/// See OpenMeshWriter().
Result<std::unique_ptr<MeshWriter>> OpenPlyWriter(const std::string& path,
                                                  const std::vector<Material>& materials, bool colors);

}  // namespace quarry::scenes
