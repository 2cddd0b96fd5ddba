#include "preprocess/import/gltf/draco/gltf_draco.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "preprocess/import/gltf/gltf_extensions.h"
#include "preprocess/import/gltf/gltf_material.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

constexpr const char* kDraco = "KHR_draco_mesh_compression";

/// Whether an attribute is one that is read.
bool IsRead(const std::string& name) {
  return name == "POSITION" || name == "NORMAL" || name == "COLOR_0" || name.starts_with("TEXCOORD_") ||
         name.starts_with("JOINTS_") || name.starts_with("WEIGHTS_");
}

}  // namespace

/// Whether the primitive's positions stand in buffer views, without compression.
bool GltfDraco::HasOwnPositions(const Json& primitive) const {
  const Json& attributes = Member(primitive, "attributes");
  const auto index = document_.Unsigned(attributes, "attributes", "POSITION");
  if (!index) return false;
  const auto position = document_.Find("accessors", *index);
  return position && ((*position)->contains("bufferView") || (*position)->contains("sparse"));
}

Result<const DracoMesh*> GltfDraco::Find(const Json& primitive, const std::string& mesh) {
  const Json& extensions = Member(primitive, "extensions");
  if (!extensions.contains(kDraco)) return nullptr;
  if (const auto found = meshes_.find(&primitive); found != meshes_.end()) return &found->second;
  if (!RequiresExtension(document_, kDraco) && HasOwnPositions(primitive)) return nullptr;
  QUARRY_ASSIGN(DracoMesh decoded, Decode(primitive, Member(extensions, kDraco), mesh));
  return &meshes_.emplace(&primitive, std::move(decoded)).first->second;
}

Result<DracoMesh> GltfDraco::Decode(const Json& primitive, const Json& extension, const std::string& mesh) {
  const std::string where = fmt::format("a primitive of {}.{}", mesh, kDraco);
  QUARRY_ASSIGN(const uint64_t mode, document_.Unsigned(primitive, mesh, "mode", GltfMode::kTriangles));
  if (mode != GltfMode::kTriangles && mode != GltfMode::kStrip)
    return document_.FailAt(fmt::format("{}: is not allowed for the mode {}", where, mode));
  QUARRY_ASSIGN(const uint64_t view_index, document_.Unsigned(extension, where, "bufferView"));
  QUARRY_ASSIGN(const Json* view, document_.Find("bufferViews", view_index));
  const std::string view_name = fmt::format("bufferViews[{}]", view_index);
  QUARRY_ASSIGN(const uint64_t buffer, document_.Unsigned(*view, view_name, "buffer"));
  QUARRY_ASSIGN(const uint64_t begin, document_.Unsigned(*view, view_name, "byteOffset", 0));
  QUARRY_ASSIGN(const uint64_t length, document_.Unsigned(*view, view_name, "byteLength"));
  // Errors: the bytes are not all there.
  QUARRY_TRY(document_.RangeOf(buffer, begin, length));
  std::vector<uint32_t> ids;
  std::vector<uint64_t> accessors;
  const Json& attributes = Member(primitive, "attributes");
  const Json& compressed = Member(extension, "attributes");
  for (const auto& [name, id] : compressed.items()) {
    if (!attributes.contains(name) || !IsRead(name)) continue;
    QUARRY_ASSIGN(const uint64_t attribute,
                  document_.Unsigned(compressed, where + ".attributes", name.c_str()));
    QUARRY_ASSIGN(const uint64_t accessor,
                  document_.Unsigned(attributes, mesh + ".attributes", name.c_str()));
    ids.push_back(static_cast<uint32_t>(std::min<uint64_t>(attribute, 0xFFFFFFFF)));
    accessors.push_back(accessor);
  }
  if (!compressed.contains("POSITION") && !HasOwnPositions(primitive))
    return document_.FailAt(fmt::format("{}.attributes.POSITION is missing", where));
  if (ids.size() > kMostDracoAttributes)
    return document_.FailAt(fmt::format("{}: more than {} attributes", where, kMostDracoAttributes));
  std::optional<uint64_t> first;  // the offset of the first decoded byte; the others follow
  const auto facts = decoder_.Decode(
      length,
      [&](uint64_t offset, std::span<std::byte> out) {
        return document_.ReadBuffer(buffer, begin + offset, out);
      },
      ids,
      [&](std::span<const std::byte> piece) -> Status {
        QUARRY_ASSIGN(const uint64_t offset, document_.decoded().Append(piece));
        if (!first) first = offset;
        return {};
      });
  if (!facts) return document_.FailAt(fmt::format("{}: {}: {}", where, view_name, facts.error().message));
  DracoMesh decoded;
  decoded.indices = first.value_or(0);
  decoded.corners = facts->corners;
  uint64_t offset = decoded.indices + decoded.corners * sizeof(uint32_t);
  for (size_t i = 0; i < accessors.size(); ++i) {
    const DracoFacts::Attribute& a = facts->attributes[i];
    decoded.attributes[accessors[i]] = {offset, facts->points, a.component_type, a.components, a.normalized};
    offset += facts->points * a.value_bytes();
  }
  return decoded;
}

}  // namespace quarry
