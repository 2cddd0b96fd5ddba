#pragma once

#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/material.h"

namespace quarry {

/// The content of `NAME.materials.json`, an optional file beside `NAME.ply`: the materials and parts that the
/// face properties `material_index` and `part_index` refer to.
///   {"materials": [{"name": "steel", "diffuse": [r,g,b], "specular": [..], "emission": [..], "reflectance":
///   [..],
///                   "transmittance": [..], "shininess": n, "ior": n, "fresnel": false, "unlit": false,
///                   "base_color": [..], "base_metalness": n, "specular_roughness": n, "specular_weight": n,
///                   "specular_color": [..], "specular_ior": n, "transmission_weight": n,
///                   "transmission_color": [..], "transmission_depth": n, "geometry_opacity": n,
///                   "is_open_pbr": true, "textures": [{"use": "diffuse", "file": "wood.png", "name": "wood",
///                   "coordinates": 0,
///                                 "wrap_s": "repeat", "wrap_t": "clamp", "transform": [6 numbers],
///                                 "factor": [4 numbers], "cutoff": n}, ...]}, ...],
///    "parts": ["boiler 1", ...]}
/// All members are optional. Without "base_color", it and the members after it are derived from the members
/// before it (DeriveOpenPbr()); without "diffuse" the members before "base_color" are derived from the others
/// (DeriveWhitted()). "is_open_pbr" says which form the file gave, where both are there: see Material.
/// A texture needs "use" (diffuse, specular, emission, opacity, normal, bump or metal_roughness) and "file";
/// wraps are repeat, clamp or mirror. See TextureBinding.
struct MaterialLibrary {
  /// A material's texture, by the file of its image.
  struct Image {
    std::string file;          ///< as the library names it
    std::string name;          ///< for people; empty: `file`
    uint32_t coordinates = 0;  ///< the set of texture coordinates that it uses
    TextureBinding binding;    ///< without the texture's number
  };
  std::vector<Material> materials;
  std::vector<std::string> parts;
  std::vector<std::vector<Image>> images;  ///< of each material; may be shorter than the materials
  std::vector<std::string> left_out;       ///< contents that the library cannot hold, such as "animations"
};

/// Writes the same JSON piece by piece, for writers whose part names do not fit in memory. Not thread-safe.
class MaterialJsonStream {
 public:
  /// Writes `materials` to `out`. Requires: `out` outlives the stream; the caller checks its state after
  /// Finish().
  MaterialJsonStream(const std::vector<Material>& materials, std::ostream& out,
                     const std::vector<std::vector<MaterialLibrary::Image>>& images = {});
  /// Appends a part.
  void AddPart(const std::string& name);
  /// Completes the JSON. Call it once, last.
  void Finish(const std::vector<std::string>& left_out = {});

 private:
  std::ostream& out_;
  bool first_ = true;
};

/// Writes `library` as JSON; equal libraries give equal bytes.
void WriteMaterialJson(const MaterialLibrary& library, std::ostream& out);

/// Reads the file at `path`. Values outside a Material's ranges are clamped.
/// Errors: cannot be opened; not JSON, with the byte; a member of the wrong kind, named.
Result<MaterialLibrary> ReadMaterialJson(const std::string& path);

/// The path of the material file that belongs to `model_path`: its extension replaced by ".materials.json".
std::string MaterialJsonPath(const std::string& model_path);

}  // namespace quarry
