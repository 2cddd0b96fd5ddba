#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/material.h"
#include "scenes/builder.h"

namespace quarry::scenes {

/// Writes a scene that comes piece by piece to a file, in memory that does not depend on the scene.
/// Call order: for each of passes(): BeginPass(), the whole scene; then Complete(). The scene must be the
/// same in each pass. Destroyed before Complete() has succeeded it leaves no file.
class MeshWriter : public MeshReceiver {
 public:
  virtual int passes() const = 0;
  virtual Status BeginPass(int pass) = 0;
  /// Ends the last pass and gives the files their names.
  virtual Status Complete() = 0;
};

/// A writer by the extension of `path`:
/// .ply: binary little-endian; vertices float x y z and, with `colors`, uchar red green blue; faces list
/// uchar uint vertex_indices,
///       ushort material_index, uint part_index; beside it NAME.materials.json
///       (common/scene/material_json.h). The format wants all vertices before the first face and no face is
///       kept, hence two passes.
/// .obj: `v x y z r g b` or `v x y z`, one group per part, beside it NAME.mtl; one pass.
/// Errors: another extension (unusable argument), files that cannot be made.
Result<std::unique_ptr<MeshWriter>> OpenMeshWriter(const std::string& path,
                                                   const std::vector<Material>& materials, bool colors);

/// A vertex's colour for a file: sRGB, as programs expect.
uint8_t SrgbByte(uint8_t linear);

/// Decides, before any work, whether the model at `path` and the files beside it (OUT.path.json among them)
/// may be written. Errors (usage): another extension; OutputGuard's.
Status CheckSceneOutputs(const std::string& path, bool force);

/// `path` with its extension replaced by `extension` (with its dot).
std::string WithExtension(const std::string& path, const std::string& extension);

}  // namespace quarry::scenes
