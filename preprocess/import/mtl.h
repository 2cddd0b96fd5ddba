#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/material.h"

namespace quarry {

/// Reads the materials of the MTL file at `path`, in file order.
/// Kd, Ks, Ke, Ns give diffuse, specular, emission and shininess. With d the dissolve (Tr = 1 - d; d wins
/// where both are given), Tf the filter and Kr the mirror weight (not standard, but
/// common):
///   illum      reflectance  transmittance         ior  fresnel
///   0 1 2 10   Kr           1-d                   1    no
///   3 8        Kr, else Ks  1-d                   1    no
///   5          Kr, else Ks  1-d                   1    yes
///   4 6        Kr, else Ks  Tf, see below        Ni   no
///   7          Kr, else Ks  Tf, see below        Ni   yes
///   9          Kr           Tf, see below        Ni   no
/// Tf not given is 1-d, or 1 where d is 1. Kr not given is 0. Diffuse is Kd times d, or Kd where Tf is used.
/// Ka, textures and unknown words are passed over; values are clamped to the ranges of Material. A line that
/// cannot be understood is passed over, with a sentence to `warn`. Errors: cannot be opened or read; a line
/// of more than 1 MiB.
Result<std::vector<Material>> ReadMtl(const std::string& path, const std::function<void(std::string)>& warn);

}  // namespace quarry
