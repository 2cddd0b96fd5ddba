#include "preprocess/import/gltf/gltf_parts.h"

#include <nlohmann/json.hpp>

namespace quarry {

void GltfParts::Met(const GltfNodes::Node& node) {
  if (places_.size() <= node.index) places_.resize(document_.json().at("nodes").size());
  places_[node.index].parent = node.parent;
}

uint32_t GltfParts::Of(uint64_t node, const std::string& mesh_name) {
  std::vector<uint64_t> way;  // from the node up to the nearest ancestor whose part is known
  uint64_t at = node;
  for (; at != GltfNodes::kNoNode && !places_[at].made; at = places_[at].parent) way.push_back(at);
  uint32_t part = at == GltfNodes::kNoNode ? kNoIndex : places_[at].part;
  for (; !way.empty(); way.pop_back()) {
    std::string name = document_.json().at("nodes").at(way.back()).value("name", "");
    if (name.empty() && way.back() == node) name = mesh_name;
    if (!name.empty()) part = sink_.AddSibling(name, part);
    places_[way.back()].part = part;
    places_[way.back()].made = true;
  }
  return part;
}

}  // namespace quarry
