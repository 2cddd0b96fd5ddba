#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "preprocess/import/gltf/gltf_vertices.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// A glTF document's materials as the sink knows them, and the attributes that their primitives' vertices
/// need.
/// Thread safety: none.
class GltfMaterials {
 public:
  GltfMaterials(GltfDocument& document, ModelSink& sink) : document_(document), sink_(sink) {}

  /// Gives all materials to the sink. Errors: the sink's.
  Status Read();

  /// A primitive's material.
  struct Use {
    uint32_t material = kNoIndex;  ///< in the scene
    GltfVertices::Wanted wanted;
  };
  /// Where the material is not opaque and the vertices' alpha is less than 1, gives the sink the material's
  /// levels of alpha. Requires: the document's decoded elements belong to the primitive. Errors: no such
  /// material; unusable colours; the sink's.
  Result<Use> Find(const nlohmann::json& primitive, const std::string& mesh);

  /// Reports to the sink the document's fields that are not read. Requires: Read().
  void WarnOfLeftOut() const;

 private:
  struct Known {
    uint32_t material = kNoIndex;
    uint32_t uv_set = 0;
    bool has_levels = false;
  };
  uint32_t UvSetOf(const nlohmann::json& primitive) const;
  Result<bool> IsSeeThrough(const nlohmann::json& primitive, const std::string& mesh);
  Status AddLevels(size_t index);

  GltfDocument& document_;
  ModelSink& sink_;
  std::vector<Known> known_;
  std::map<uint64_t, bool> see_through_;  ///< accessors of colours: whether an alpha is less than 1
};

}  // namespace quarry
