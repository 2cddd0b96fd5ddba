#include "preprocess/import/gltf/gltf_extensions.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "preprocess/import/gltf/gltf_material.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

/// Extensions that Quarry reads.
constexpr std::string_view kRead[] = {"EXT_mesh_gpu_instancing", "EXT_meshopt_compression",
                                      "EXT_texture_webp",        "KHR_draco_mesh_compression",
                                      "KHR_lights_punctual",     "KHR_materials_emissive_strength",
                                      "KHR_materials_ior",       "KHR_materials_pbrSpecularGlossiness",
                                      "KHR_materials_specular",  "KHR_materials_transmission",
                                      "KHR_materials_unlit",     "KHR_materials_volume",
                                      "KHR_mesh_quantization",   "KHR_node_visibility",
                                      "KHR_texture_transform"};

/// Extensions that only cost images: each gives a warning, and the model is read.
constexpr std::string_view kTolerated[] = {"KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds"};

/// Parts of the names of extensions that change a mesh's triangles.
constexpr std::string_view kOfGeometry[] = {
    "instancing",  "displacement", "micromesh",         "splat",     "voxel",     "quantized",
    "subdivision", "nurbs",        "primitive_restart", "implicit_", "CESIUM_RTC"};

template <class List>
bool Holds(const List& list, std::string_view name) {
  return std::ranges::find(list, name) != std::end(list);
}

bool ChangesGeometry(std::string_view name) {
  return std::ranges::any_of(kOfGeometry,
                             [&](std::string_view part) { return name.find(part) != name.npos; });
}

/// Names in a list of the document, without repetition.
std::set<std::string> NamesIn(const Json& json, const char* list) {
  std::set<std::string> names;
  const auto it = json.find(list);
  if (it != json.end() && it->is_array())
    for (const Json& name : *it) names.insert(name.is_string() ? name.get<std::string>() : name.dump());
  return names;
}

}  // namespace

Result<std::vector<std::string>> CheckGltfExtensions(const GltfDocument& document) {
  for (const std::string& name : NamesIn(document.json(), "extensionsRequired"))
    if (!Holds(kRead, name) && !Holds(kTolerated, name))
      return document.FailAt(fmt::format(
          "needs the extension {}, which is not read; export the model without it", Quoted(name)));
  std::vector<std::string> warnings;
  for (const std::string& name : NamesIn(document.json(), "extensionsUsed")) {
    if (Holds(kRead, name)) continue;
    if (ChangesGeometry(name))
      return document.FailAt(
          fmt::format("uses the extension {}, which changes its geometry and is not read; export the model "
                      "without it",
                      Quoted(name)));
    warnings.push_back(
        document
            .FailAt(fmt::format("the extension {} is not read; the model is loaded without it", Quoted(name)))
            .value()
            .message);
  }
  return warnings;
}

bool RequiresExtension(const GltfDocument& document, const std::string& name) {
  return NamesIn(document.json(), "extensionsRequired").contains(name);
}

Status CheckNotCompressed(const GltfDocument& document, const Json& object, const std::string& where,
                          bool has_copy) {
  if (has_copy) return {};
  for (const auto& [name, value] : Member(object, "extensions").items())
    if (name.find("compression") != name.npos)
      return document.FailAt(
          fmt::format("{} is compressed by the extension {}, which is not read; export the model without it",
                      where, Quoted(name)));
  return {};
}

}  // namespace quarry
