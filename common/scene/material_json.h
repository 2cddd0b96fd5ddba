#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/material.h"

namespace quarry {

/// The `NAME.materials.json` that may stand beside `NAME.ply`: what the face properties `material_index` and
/// `part_index` refer to.
///   {"materials": [{"name": "steel", "diffuse": [r,g,b], "specular": [..], "emission": [..], "reflectance":
///   [..],
///                   "transmittance": [..], "shininess": n, "ior": n, "fresnel": false, "unlit": false,
///                   "base_color": [..], "base_metalness": n, "specular_roughness": n, "specular_weight": n,
///                   "specular_color": [..], "specular_ior": n, "transmission_weight": n,
///                   "transmission_color": [..], "transmission_depth": n, "geometry_opacity": n}, ...],
///    "parts": ["boiler 1", ...]}
/// Every member of a material may be left out; "parts" too. Without "base_color" the members below it follow
/// from those above it (DeriveOpenPbr), without "diffuse" those above from those below (DeriveWhitted).
struct MaterialLibrary {
  std::vector<Material> materials;
  std::vector<std::string> parts;
};

/// Writes the same form piece by piece, for a writer whose part names do not fit its memory.
class MaterialJsonStream {
 public:
  /// `out` must outlive the stream; the caller checks its state after Finish().
  MaterialJsonStream(const std::vector<Material>& materials, std::ostream& out);
  void AddPart(const std::string& name);
  /// Completes the JSON; call it once, last.
  void Finish();

 private:
  std::ostream& out_;
  bool first_ = true;
};

/// Writes `library` as above; the same bytes for the same library.
void WriteMaterialJson(const MaterialLibrary& library, std::ostream& out);

/// Reads `path`. Values outside a Material's ranges are clamped.
/// Errors: cannot be opened, not JSON (with the byte), a member of the wrong kind (named).
Result<MaterialLibrary> ReadMaterialJson(const std::string& path);

/// The path of the material file that belongs to `model_path`: its extension replaced by ".materials.json".
std::string MaterialJsonPath(const std::string& model_path);

}  // namespace quarry
