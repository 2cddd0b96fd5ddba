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

/// Reads the vertices of one primitive from the first to the last: morph targets added by their weights, then
/// moved by the joints of a skin, if there is one, else by the node.
class GltfVertices {
 public:
  struct Vertex {
    glm::dvec3 position;
    glm::vec3 normal{0};
    glm::vec2 uv{0};
    Rgba8 color;
  };
  /// The primitive is one of `mesh`. `weights`: of its morph targets; `joints`: of its skin, empty without
  /// one; they must outlive the object. Requires: it has positions. Errors: accessors that are not there,
  /// differ in their counts, or cannot be.
  static Result<GltfVertices> Open(GltfDocument& document, const nlohmann::json& primitive,
                                   const std::string& mesh, std::span<const double> weights,
                                   std::span<const glm::dmat4> joints);

  uint64_t count() const { return position_->count(); }
  bool has_normals() const { return normal_.has_value(); }
  bool has_uvs() const { return uv_.has_value(); }
  /// Whether joints move it: the node does not.
  bool skinned() const { return !influences_.empty(); }
  /// `turn`: the inverse transpose of `world`, for normals. Errors: a joint that there is not.
  Result<Vertex> Next(const glm::dmat4& world, const glm::dmat3& turn);

 private:
  /// What a morph target adds.
  struct Target {
    double weight;
    std::optional<GltfAccessor> position, normal;
  };
  /// Four joints of each vertex, and how much each moves it.
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
};

}  // namespace quarry
