#include "deploy/command/parts_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/vec3.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "common/remote/open_store.h"
#include "common/voxel/part_tree.h"
#include "common/voxel/store_reader.h"

namespace quarry {
namespace {

using Json = nlohmann::ordered_json;

/// The surface of the part's own triangles, for people.
const char* SurfaceOf(const PartTree& tree, uint32_t part) {
  if (!tree.has_tree()) return "-";
  if (tree[part].triangles == 0) return "group";
  if (tree[part].flags & PartTree::Part::kInsideOut) return "inverted";
  return tree[part].flags & PartTree::Part::kClosed ? "closed" : "open";
}

bool HasBox(const PartTree::Total& total) { return total.lower.x <= total.upper.x; }

/// "part NUMBER TRIANGLES SURFACE SIZE PATH": the path comes last, as it may have blanks.
std::string LineOf(const PartTree& tree, uint32_t part) {
  const PartTree::Total& total = tree.total(part);
  const glm::vec3 size = total.upper - total.lower;
  return fmt::format("part {} {} {} {} {}\n", part,
                     tree.has_tree() ? fmt::format("{}", total.triangles) : "-", SurfaceOf(tree, part),
                     HasBox(total) ? fmt::format("{:.4g}x{:.4g}x{:.4g}", size.x, size.y, size.z) : "-",
                     PrintableName(tree.Path(part)));
}

/// Facts that the store does not have are null. The box is in the model's coordinates.
Json JsonOf(const PartTree& tree, uint32_t part, const std::string& attributes, const glm::dvec3& offset) {
  const PartTree::Total& total = tree.total(part);
  const bool own = tree[part].triangles > 0;
  const uint32_t flags = tree[part].flags, parent = tree[part].parent;
  Json j{{"id", part}, {"path", tree.Path(part)}, {"name", tree.name(part)}};
  j["parent"] = parent == PartTree::kNone ? Json() : Json(parent);
  j["children"] = tree.child_count(part);
  j["triangles"] = tree.has_tree() ? Json(total.triangles) : Json();
  j["own_triangles"] = tree.has_tree() ? Json(tree[part].triangles) : Json();
  j["closed"] = own ? Json((flags & PartTree::Part::kClosed) != 0) : Json();
  j["inside_out"] = own ? Json((flags & PartTree::Part::kInsideOut) != 0) : Json();
  j["box"] = Json();
  if (HasBox(total))
    for (const glm::vec3& corner : {total.lower, total.upper}) {
      const glm::dvec3 at = glm::dvec3(corner) + offset;
      j["box"].push_back({at.x, at.y, at.z});
    }
  if (!attributes.empty()) j["attributes"] = Json::parse(attributes);
  return j;
}

/// All parts, each behind its parent.
std::vector<uint32_t> InOrderOfTree(const PartTree& tree) {
  std::vector<uint32_t> order, coming = tree.Children(PartTree::kNone, 0, tree.size());
  std::ranges::reverse(coming);
  while (!coming.empty()) {
    order.push_back(coming.back());
    coming.pop_back();
    const std::vector<uint32_t> children = tree.Children(order.back(), 0, tree.size());
    coming.insert(coming.end(), children.rbegin(), children.rend());
  }
  return order;
}

}  // namespace

Status PrintParts(const std::string& scene, const std::string& find, bool json, const HttpOptions& http) {
  QUARRY_ASSIGN(const StoreReader store, OpenStore(scene, http));
  QUARRY_ASSIGN(const std::shared_ptr<const PartTree> tree, PartTree::Read(store));
  if (json) {
    QUARRY_ASSIGN(const PartAttributes attributes, store.part_sections().ReadAttributes());
    PrintRaw("[");
    const char* separator = "\n";
    for (const uint32_t part : tree->Find(find, 0, tree->size()).parts) {
      QUARRY_ASSIGN(const std::string own, attributes.Of(part));
      const Json j = JsonOf(*tree, part, own, store.catalog().meta.offset);
      if (!PrintRaw(separator + j.dump(-1, ' ', false, Json::error_handler_t::replace))) return {};
      separator = ",\n";
    }
    PrintRaw("\n]\n");
    return {};
  }
  const std::vector<uint32_t> parts =
      find.empty() ? InOrderOfTree(*tree) : tree->Find(find, 0, tree->size()).parts;
  for (const uint32_t part : parts)
    if (!Print(LineOf(*tree, part))) return {};
  if (!find.empty()) return {};
  for (uint32_t m = 0; m < store.catalog().materials.size(); ++m) {
    QUARRY_ASSIGN(const std::string name, store.MaterialName(m));
    if (!Print(fmt::format("material {} {}\n", m, PrintableName(name)))) return {};
  }
  return {};
}

}  // namespace quarry
