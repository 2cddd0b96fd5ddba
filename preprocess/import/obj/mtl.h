#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/material.h"
#include "preprocess/import/obj/mtl_texture.h"

namespace quarry {

/// A material of an MTL file. `textures` holds its texture bindings, at most one a use, ascending by use,
/// each complete but for its texture.
struct MtlMaterial {
  Material material;
  std::vector<MtlTexture> textures;
};

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
/// OpenPBR's parameters follow from these (DeriveOpenPbr: roughness is sqrt(2 / (Ns + 2))). Where Pm or Pr is
/// given, metalness and roughness of a usual extension, they say how Kd shines instead of Ks, Kr and illum,
/// but for 4, 6, 7 and 9.
/// Textures: see ParseMtlTexture; where a colour has one but is not given itself, it is 1. Of several for one
/// use the last counts. Without map_d, the alpha of map_Kd is the opacity. `warn` gets each word that is not
/// read, once; values are clamped to the ranges of Material. A line that cannot be understood is passed over,
/// with a sentence to `warn`. Errors: cannot be opened or read; a line of more than 1 MiB.
Result<std::vector<MtlMaterial>> ReadMtl(const std::string& path,
                                         const std::function<void(std::string)>& warn);

}  // namespace quarry
