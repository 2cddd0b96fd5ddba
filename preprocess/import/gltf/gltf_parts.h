#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "preprocess/import/gltf/gltf_document.h"
#include "preprocess/import/gltf/gltf_nodes.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// The parts that a glTF's nodes make: a node with a name is a part below its ancestors' if a mesh lies in it
/// or below it. Siblings of one name are parts of their own. Memory: 16 bytes a node. Thread safety: none.
class GltfParts {
 public:
  GltfParts(const GltfDocument& document, ModelSink& sink) : document_(document), sink_(sink) {}

  /// Notes the place of a node. Parents come before their children.
  void Met(const GltfNodes::Node& node);
  /// The part of a node's mesh. A node without a name has the mesh's; without both, the mesh belongs to the
  /// part of the nearest ancestor with a name. kNoIndex: there is none. A new part's attributes are the
  /// `extras` of its node, and the mesh's where the node has no such member. Requires: Met() of the node.
  uint32_t Of(uint64_t node, const nlohmann::json& mesh);

 private:
  struct Place {
    uint64_t parent = GltfNodes::kNoNode;
    uint32_t part = kNoIndex;
    bool made = false;  ///< `part` is the node's, or that of the nearest ancestor with one
  };

  void SetAttributes(uint32_t part, const nlohmann::json& node, const nlohmann::json* mesh);

  const GltfDocument& document_;
  ModelSink& sink_;
  std::vector<Place> places_;  ///< by node
};

}  // namespace quarry
