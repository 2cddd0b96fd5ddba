#include "common/scene/material_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <ostream>

#include "common/base/json_file.h"
#include "common/scene/open_pbr.h"

namespace quarry {
namespace {

// Keys stay in the order of writing. Numbers have single precision, so that 0.8f is written as "0.8" and read
// back to the same bits.
using Json = FloatJson;

/// Parts of large models are written one by one.
constexpr JsonLimits kLimits{256u << 20, 8, 16u << 20, 1000};

Json ToJson(const glm::vec3& v) { return Json::array({v.x, v.y, v.z}); }

Json ToJson(const Material& material) {
  Json json;
  json["name"] = material.name;
  json["diffuse"] = ToJson(material.diffuse);
  json["specular"] = ToJson(material.specular);
  json["emission"] = ToJson(material.emission);
  json["reflectance"] = ToJson(material.reflectance);
  json["transmittance"] = ToJson(material.transmittance);
  json["shininess"] = material.shininess;
  json["ior"] = material.ior;
  json["fresnel"] = material.fresnel;
  json["unlit"] = material.unlit;
  json["base_color"] = ToJson(material.base_color);
  json["base_metalness"] = material.base_metalness;
  json["specular_roughness"] = material.specular_roughness;
  json["specular_weight"] = material.specular_weight;
  json["specular_color"] = ToJson(material.specular_color);
  json["specular_ior"] = material.specular_ior;
  json["transmission_weight"] = material.transmission_weight;
  json["transmission_color"] = ToJson(material.transmission_color);
  json["transmission_depth"] = material.transmission_depth;
  json["geometry_opacity"] = material.geometry_opacity;
  return json;
}

// A name from a model file may hold any bytes; bytes that are not UTF-8 become U+FFFD.
std::string Text(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

std::string Where(size_t index, const char* member) { return fmt::format("materials[{}].{}", index, member); }

/// The place of the material being read, for messages about errors.
struct Member {
  const std::string& path;
  size_t index;
  const char* name;

  tl::unexpected<Error> Wrong(const char* expected) const {
    return Fail(
        fmt::format("{}: {} must be {}; correct it, or leave it out.", path, Where(index, name), expected));
  }
};

Status ReadNumber(const Json& json, const Member& member, float low, float high, float& value) {
  const auto found = json.find(member.name);
  if (found == json.end()) return {};
  if (!found->is_number()) return member.Wrong("a number");
  value = std::clamp(found->get<float>(), low, high);
  return {};
}

Status ReadColour(const Json& json, const Member& member, float high, glm::vec3& value) {
  const auto found = json.find(member.name);
  if (found == json.end()) return {};
  if (!found->is_array() || found->size() != 3) return member.Wrong("an array of three numbers");
  for (int axis = 0; axis < 3; ++axis) {
    const Json& component = (*found)[axis];
    if (!component.is_number()) return member.Wrong("an array of three numbers");
    value[axis] = std::clamp(component.get<float>(), 0.0f, high);
  }
  return {};
}

Status ReadFlag(const Json& json, const Member& member, bool& value) {
  const auto found = json.find(member.name);
  if (found == json.end()) return {};
  if (!found->is_boolean()) return member.Wrong("true or false");
  value = found->get<bool>();
  return {};
}

Result<Material> ReadMaterial(const Json& json, const std::string& path, size_t index) {
  if (!json.is_object()) return Fail(fmt::format("{}: materials[{}] must be an object.", path, index));
  constexpr float kLargest = std::numeric_limits<float>::max();
  Material material;
  const auto member = [&](const char* name) { return Member{path, index, name}; };
  if (const auto name = json.find("name"); name != json.end()) {
    if (!name->is_string()) return member("name").Wrong("a string");
    material.name = name->get<std::string>();
  }
  QUARRY_TRY(ReadColour(json, member("diffuse"), 1.0f, material.diffuse));
  QUARRY_TRY(ReadColour(json, member("specular"), 1.0f, material.specular));
  QUARRY_TRY(ReadColour(json, member("emission"), kLargest, material.emission));
  QUARRY_TRY(ReadColour(json, member("reflectance"), 1.0f, material.reflectance));
  QUARRY_TRY(ReadColour(json, member("transmittance"), 1.0f, material.transmittance));
  QUARRY_TRY(ReadNumber(json, member("shininess"), 0.0f, 10000.0f, material.shininess));
  QUARRY_TRY(ReadNumber(json, member("ior"), 1.0f, 10.0f, material.ior));
  QUARRY_TRY(ReadFlag(json, member("fresnel"), material.fresnel));
  QUARRY_TRY(ReadFlag(json, member("unlit"), material.unlit));
  if (!json.contains("base_color")) {
    DeriveOpenPbr(material);
    return material;
  }
  QUARRY_TRY(ReadColour(json, member("base_color"), 1.0f, material.base_color));
  QUARRY_TRY(ReadNumber(json, member("base_metalness"), 0.0f, 1.0f, material.base_metalness));
  QUARRY_TRY(ReadNumber(json, member("specular_roughness"), 0.0f, 1.0f, material.specular_roughness));
  QUARRY_TRY(ReadNumber(json, member("specular_weight"), 0.0f, 1.0f, material.specular_weight));
  QUARRY_TRY(ReadColour(json, member("specular_color"), 1.0f, material.specular_color));
  QUARRY_TRY(ReadNumber(json, member("specular_ior"), 1.0f, 10.0f, material.specular_ior));
  QUARRY_TRY(ReadNumber(json, member("transmission_weight"), 0.0f, 1.0f, material.transmission_weight));
  QUARRY_TRY(ReadColour(json, member("transmission_color"), 1.0f, material.transmission_color));
  QUARRY_TRY(ReadNumber(json, member("transmission_depth"), 0.0f, kLargest, material.transmission_depth));
  QUARRY_TRY(ReadNumber(json, member("geometry_opacity"), 0.0f, 1.0f, material.geometry_opacity));
  if (!json.contains("diffuse")) DeriveWhitted(material, true);
  return material;
}

}  // namespace

MaterialJsonStream::MaterialJsonStream(const std::vector<Material>& materials, std::ostream& out)
    : out_(out) {
  out_ << "{\"materials\": [";
  const char* separator = "\n  ";
  for (const Material& material : materials) {
    out_ << separator << Text(ToJson(material));
    separator = ",\n  ";
  }
  out_ << "],\n\"parts\": [";
}

void MaterialJsonStream::AddPart(const std::string& name) {
  out_ << (first_ ? "\n  " : ",\n  ") << Text(Json(name));
  first_ = false;
}

void MaterialJsonStream::Finish() { out_ << "]}\n"; }

void WriteMaterialJson(const MaterialLibrary& library, std::ostream& out) {
  MaterialJsonStream stream(library.materials, out);
  for (const std::string& part : library.parts) stream.AddPart(part);
  stream.Finish();
}

Result<MaterialLibrary> ReadMaterialJson(const std::string& path) {
  QUARRY_ASSIGN(const Json json, ReadJsonFile<Json>(path, kLimits));
  if (!json.is_object()) return Fail(fmt::format("{}: must hold one JSON object.", path));
  MaterialLibrary library;
  if (const auto materials = json.find("materials"); materials != json.end()) {
    if (!materials->is_array()) return Fail(fmt::format("{}: materials must be an array.", path));
    for (size_t i = 0; i < materials->size(); ++i) {
      QUARRY_ASSIGN(Material material, ReadMaterial((*materials)[i], path, i));
      library.materials.push_back(std::move(material));
    }
  }
  if (const auto parts = json.find("parts"); parts != json.end()) {
    if (!parts->is_array()) return Fail(fmt::format("{}: parts must be an array.", path));
    for (size_t i = 0; i < parts->size(); ++i) {
      if (!(*parts)[i].is_string()) return Fail(fmt::format("{}: parts[{}] must be a string.", path, i));
      library.parts.push_back((*parts)[i].get<std::string>());
    }
  }
  return library;
}

std::string MaterialJsonPath(const std::string& model_path) {
  const size_t name = model_path.find_last_of('/') + 1;  // npos + 1 is 0: no folder.
  const size_t dot = model_path.find_last_of('.');
  const bool has_extension = dot != std::string::npos && dot > name;
  return (has_extension ? model_path.substr(0, dot) : model_path) + ".materials.json";
}

}  // namespace quarry
