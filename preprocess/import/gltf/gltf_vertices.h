#pragma once

#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "preprocess/import/gltf/gltf_accessor.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Reads the vertices of a primitive in order: morph targets are added by weight, then the skin's joints or
/// the node move the vertex. Thread safety: none.
class GltfVertices {
 public:
  struct Vertex {
    glm::dvec3 position;
    glm::vec3 normal{0};
    glm::vec2 uv{0};
    Rgba8 color;
  };
  /// The attributes of a primitive that its material uses.
  struct Wanted {
    uint32_t uv_set = 0;  ///< n of TEXCOORD_n
    bool alpha = false;   ///< whether the alpha of COLOR_0 counts
  };
  /// `weights`: of the morph targets. `joints`: of the skin; empty: no skin. Both, and `mesh`, must outlive
  /// the object. Requires: the primitive has positions. Errors: accessors are absent, unusable, or of
  /// different counts.
  static Result<GltfVertices> Open(GltfDocument& document, const nlohmann::json& primitive,
                                   const std::string& mesh, std::span<const double> weights,
                                   std::span<const glm::dmat4> joints, Wanted wanted);

  uint64_t count() const { return position_->count(); }
  bool has_normals() const { return normal_.has_value(); }
  bool has_uvs() const { return uv_.has_value(); }
  /// Whether joints move the primitive; the node then does not.
  bool skinned() const { return !influences_.empty(); }
  /// The next vertex. `turn`: the inverse transpose of `world`, for normals. Errors: no such joint.
  Result<Vertex> Next(const glm::dmat4& world, const glm::dmat3& turn);

 private:
  /// The differences of a morph target.
  struct Target {
    double weight;
    std::optional<GltfAccessor> position, normal;
  };
  /// Four joints of each vertex and their weights.
  struct Influences {
    std::optional<GltfAccessor> joints, weights;
  };
  explicit GltfVertices(GltfDocument& document) : document_(&document) {}
  Result<glm::dmat4> Skinning();

  GltfDocument* document_;
  std::string mesh_;
  std::optional<GltfAccessor> position_, normal_, uv_, color_;
  std::vector<Target> targets_;
  std::vector<Influences> influences_;
  std::span<const glm::dmat4> joints_;
  bool alpha_ = false;
};

}  // namespace quarry
