#include "preprocess/import/gltf/gltf_parts.h"

#include <nlohmann/json.hpp>

namespace quarry {

void GltfParts::Met(const GltfNodes::Node& node) {
  if (places_.size() <= node.index) places_.resize(document_.json().at("nodes").size());
  places_[node.index].parent = node.parent;
}

void GltfParts::SetAttributes(uint32_t part, const nlohmann::json& node, const nlohmann::json* mesh) {
  nlohmann::json attributes = nlohmann::json::object();
  for (const nlohmann::json* from : {&node, mesh}) {
    if (!from || !from->contains("extras")) continue;
    const nlohmann::json& extras = from->at("extras");
    if (extras.is_object())
      attributes.insert(extras.begin(), extras.end());  // which keeps members that are there
    else if (!extras.is_null())
      attributes.emplace("extras", extras);
  }
  if (!attributes.empty())
    sink_.SetAttributes(part, attributes.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

uint32_t GltfParts::Of(uint64_t node, const nlohmann::json& mesh) {
  std::vector<uint64_t> way;  // from the node up to the nearest ancestor whose part is known
  uint64_t at = node;
  for (; at != GltfNodes::kNoNode && !places_[at].made; at = places_[at].parent) way.push_back(at);
  uint32_t part = at == GltfNodes::kNoNode ? kNoIndex : places_[at].part;
  for (; !way.empty(); way.pop_back()) {
    const nlohmann::json& json = document_.json().at("nodes").at(way.back());
    const bool own = way.back() == node;
    std::string name = json.value("name", "");
    if (name.empty() && own) name = mesh.value("name", "");
    if (!name.empty()) {
      part = sink_.AddSibling(name, part);
      SetAttributes(part, json, own ? &mesh : nullptr);
    }
    places_[way.back()].part = part;
    places_[way.back()].made = true;
  }
  return part;
}

}  // namespace quarry
