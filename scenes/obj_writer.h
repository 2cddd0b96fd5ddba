#pragma once

#include <string>
#include <vector>

#include "scenes/mesh_writer.h"

namespace quarry::scenes {

/// See OpenMeshWriter().
Result<std::unique_ptr<MeshWriter>> OpenObjWriter(const std::string& path,
                                                  const std::vector<Material>& materials, bool colors);

/// `materials` as an MTL file. A mirror is illum 3 with its reflectance as Ks, glass is illum 7 with Ks, Tf
/// (the transmittance) and Ni; MTL has one Ks for highlight and mirror, so a reflective material's own
/// `specular` is lost unless it equals the reflectance.
std::string MtlText(const std::vector<Material>& materials);

}  // namespace quarry::scenes
