#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "common/base/status.h"
#include "preprocess/import/gltf/draco/draco_decoder.h"
#include "preprocess/import/gltf/gltf_document.h"

namespace quarry {

/// A primitive's decoded mesh. Whatever the primitive's mode, its corners make a list of triangles.
struct DracoMesh {
  GltfDecoded::Elements attributes;   ///< by the primitive's accessors
  uint64_t indices = 0, corners = 0;  ///< offset in the decoded bytes; vertices' numbers as uint32
};

/// Decodes the primitives that KHR_draco_mesh_compression compresses, each once. Thread safety: none.
class GltfDraco {
 public:
  explicit GltfDraco(GltfDocument& document)
      : document_(document),
        decoder_(document.decoded().decoding().draco, document.decoded().decoding().memory) {}

  /// The mesh of a primitive of `mesh`; null if it is not compressed, or has a copy that is not and the
  /// document does not require the extension. Requires: the primitive is part of the document. Errors, with
  /// the mesh's and the view's name: members of the extension are absent or unusable; DracoDecoder's.
  Result<const DracoMesh*> Find(const nlohmann::json& primitive, const std::string& mesh);

 private:
  Result<DracoMesh> Decode(const nlohmann::json& primitive, const nlohmann::json& extension,
                           const std::string& mesh);
  bool HasOwnPositions(const nlohmann::json& primitive) const;

  GltfDocument& document_;
  DracoDecoder decoder_;
  std::map<const nlohmann::json*, DracoMesh> meshes_;  ///< by primitive
};

}  // namespace quarry
