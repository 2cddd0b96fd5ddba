#pragma once

#include <cstdint>
#include <glm/mat4x4.hpp>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_accessor.h"
#include "preprocess/import/gltf/gltf_document.h"

namespace quarry {

/// A node's own transform. Errors: a matrix that has not 16 numbers.
Result<glm::dmat4> LocalTransform(const GltfDocument& document, const nlohmann::json& node, uint64_t index);

/// The nodes of the scene to show; of all nodes those that are no children, where no scene is given.
Result<std::vector<uint64_t>> SceneRoots(const GltfDocument& document);

/// Goes through the nodes of the scene, parents before children. Each node's transform is to the world.
class GltfNodes {
 public:
  struct Node {
    uint64_t index;
    const nlohmann::json* json;
    glm::dmat4 world;
  };
  /// Errors: no such scene.
  static Result<GltfNodes> Open(const GltfDocument& document);
  /// Errors: a node that is not there, that is met twice, whose matrix cannot be. Nodes that
  /// KHR_node_visibility hides, and all below them, are passed over. Nothing after the last.
  Result<std::optional<Node>> Next();

 private:
  explicit GltfNodes(const GltfDocument& document) : document_(&document) {}
  const GltfDocument* document_;
  std::vector<std::pair<uint64_t, glm::dmat4>> stack_;  ///< with the parent's transform
  std::vector<bool> visited_;
};

/// What moves the vertices of each joint of a skin at rest: the joint's transform to the world after its
/// inverse bind matrix. A skinned mesh ignores its own node.
class GltfSkins {
 public:
  explicit GltfSkins(GltfDocument& document) : document_(document) {}
  /// Errors: a skin, joint or matrix that is not there; a joint below itself.
  Result<std::vector<glm::dmat4>> Joints(uint64_t skin);

 private:
  Result<glm::dmat4> World(uint64_t node);
  GltfDocument& document_;
  std::vector<uint64_t> parents_;  ///< by node; once a skin was asked for
};

/// The instances that EXT_mesh_gpu_instancing makes of a node, one after the other.
class GltfInstances {
 public:
  /// `node` is called `where`. Errors: accessors that are not there, differ in their counts, or cannot be.
  static Result<GltfInstances> Open(GltfDocument& document, const nlohmann::json& node,
                                    const std::string& where);
  /// 1 for a node without the extension.
  uint64_t count() const { return count_; }
  /// The next one's transform, before the node's. Requires: fewer than count() were taken.
  Result<glm::dmat4> Next();

 private:
  std::optional<GltfAccessor> translation_, rotation_, scale_;
  uint64_t count_ = 1;
};

}  // namespace quarry
