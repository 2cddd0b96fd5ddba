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

/// A node's own transform. Errors: a matrix without 16 numbers.
Result<glm::dmat4> LocalTransform(const GltfDocument& document, const nlohmann::json& node, uint64_t index);

/// The roots of the scene to show; if the document names no scene, all nodes that are no children.
Result<std::vector<uint64_t>> SceneRoots(const GltfDocument& document);

/// Walks the scene's nodes, parents before children. Transforms are to the world. Thread safety: none.
class GltfNodes {
 public:
  static constexpr uint64_t kNoNode = ~uint64_t{0};
  struct Node {
    uint64_t index;
    uint64_t parent;  ///< kNoNode: a root
    const nlohmann::json* json;
    glm::dmat4 world;
  };
  /// Errors: no such scene.
  static Result<GltfNodes> Open(const GltfDocument& document);
  /// The next node; nothing after the last. Nodes hidden by KHR_node_visibility are skipped with their
  /// children. Errors: a node is absent, is met twice, or has an unusable matrix.
  Result<std::optional<Node>> Next();

 private:
  explicit GltfNodes(const GltfDocument& document) : document_(&document) {}
  const GltfDocument* document_;
  struct Coming {
    uint64_t index, parent;
    glm::dmat4 world;  ///< the parent's
  };
  std::vector<Coming> stack_;  ///< nodes to visit
  std::vector<bool> visited_;
};

/// The matrices that move a skin's vertices at rest: each joint's world transform after its inverse bind
/// matrix. A skinned mesh ignores its own node's transform. Thread safety: none.
class GltfSkins {
 public:
  explicit GltfSkins(GltfDocument& document) : document_(document) {}
  /// The matrices of a skin's joints. Errors: a skin, joint or matrix is absent; a joint is its own
  /// descendant.
  Result<std::vector<glm::dmat4>> Joints(uint64_t skin);

 private:
  Result<glm::dmat4> World(uint64_t node);
  GltfDocument& document_;
  std::vector<uint64_t> parents_;  ///< of each node; filled when a skin is first asked for
};

/// The instances that EXT_mesh_gpu_instancing makes of a node, in order. Thread safety: none.
class GltfInstances {
 public:
  /// `where` names the node in errors. Errors: accessors are absent, unusable, or of different counts.
  static Result<GltfInstances> Open(GltfDocument& document, const nlohmann::json& node,
                                    const std::string& where);
  /// 1 for a node without the extension.
  uint64_t count() const { return count_; }
  /// The next instance's transform, which applies before the node's. Requires: fewer than count() were read.
  Result<glm::dmat4> Next();

 private:
  std::optional<GltfAccessor> translation_, rotation_, scale_;
  uint64_t count_ = 1;
};

}  // namespace quarry
