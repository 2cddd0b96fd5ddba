#include "common/scene/material_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <ostream>
#include <utility>

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
  if (material.is_open_pbr != AgreesWithOpenPbr(material)) json["is_open_pbr"] = material.is_open_pbr;
  return json;
}

constexpr const char* kUses[kTextureUses] = {"diffuse", "specular", "emission",       "opacity",
                                             "normal",  "bump",     "metal_roughness"};
constexpr const char* kWraps[kTextureWraps] = {"repeat", "clamp", "mirror"};

Json ToJson(const MaterialLibrary::Image& image) {
  const TextureBinding& b = image.binding;
  Json json;
  json["use"] = kUses[static_cast<size_t>(b.use)];
  json["file"] = image.file;
  if (!image.name.empty()) json["name"] = image.name;
  json["coordinates"] = image.coordinates;
  json["wrap_s"] = kWraps[static_cast<size_t>(b.wrap_s)];
  json["wrap_t"] = kWraps[static_cast<size_t>(b.wrap_t)];
  json["transform"] = Json(b.transform);
  json["factor"] = Json::array({b.factor.x, b.factor.y, b.factor.z, b.factor.w});
  json["cutoff"] = b.cutoff;
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
  if (json.contains("diffuse"))
    material.is_open_pbr = AgreesWithOpenPbr(material);
  else
    DeriveWhitted(material, true);
  QUARRY_TRY(ReadFlag(json, member("is_open_pbr"), material.is_open_pbr));
  return material;
}

/// One of `names`, by its number.
template <size_t kCount>
Status ReadName(const Json& json, const char* key, const char* const (&names)[kCount], size_t& number) {
  const auto found = json.find(key);
  if (found == json.end()) return {};
  const auto it = found->is_string() ? std::ranges::find(names, found->get<std::string>()) : std::end(names);
  if (it == std::end(names)) return Fail(key);
  number = static_cast<size_t>(it - std::begin(names));
  return {};
}

template <class Numbers>
Status ReadNumbers(const Json& json, const char* key, size_t count, Numbers& numbers) {
  const auto found = json.find(key);
  if (found == json.end()) return {};
  if (!found->is_array() || found->size() != count) return Fail(key);
  for (size_t i = 0; i < count; ++i) {
    constexpr float kLargest = std::numeric_limits<float>::max();
    if (!(*found)[i].is_number()) return Fail(key);
    numbers[static_cast<int>(i)] = std::clamp((*found)[i].get<float>(), -kLargest, kLargest);
  }
  return {};
}

/// Errors: the member at fault.
Result<MaterialLibrary::Image> ReadImage(const Json& json) {
  MaterialLibrary::Image image;
  if (!json.is_object()) return Fail("");
  size_t use = kTextureUses, wrap_s = 0, wrap_t = 0;
  QUARRY_TRY(ReadName(json, "use", kUses, use));
  QUARRY_TRY(ReadName(json, "wrap_s", kWraps, wrap_s));
  QUARRY_TRY(ReadName(json, "wrap_t", kWraps, wrap_t));
  if (use == kTextureUses) return Fail("use");
  image.binding.use = static_cast<TextureUse>(use);
  image.binding.wrap_s = static_cast<TextureWrap>(wrap_s);
  image.binding.wrap_t = static_cast<TextureWrap>(wrap_t);
  for (const auto& [key, text] : {std::pair("file", &image.file), std::pair("name", &image.name)}) {
    const auto found = json.find(key);
    if (found == json.end()) continue;
    if (!found->is_string()) return Fail(key);
    *text = found->get<std::string>();
  }
  if (image.file.empty()) return Fail("file");
  if (const auto found = json.find("coordinates"); found != json.end()) {
    if (!found->is_number_unsigned() || found->get<uint64_t>() > 255) return Fail("coordinates");
    image.coordinates = found->get<uint32_t>();
  }
  float* const transform = image.binding.transform.data();
  QUARRY_TRY(ReadNumbers(json, "transform", 6, transform));
  QUARRY_TRY(ReadNumbers(json, "factor", 4, image.binding.factor));
  float cutoff[1] = {0};
  if (const auto found = json.find("cutoff"); found != json.end()) {
    if (!found->is_number()) return Fail("cutoff");
    cutoff[0] = std::clamp(found->get<float>(), 0.0f, 1.0f);
  }
  image.binding.cutoff = cutoff[0];
  return image;
}

/// The textures of a material, at most one of a use, by use.
Result<std::vector<MaterialLibrary::Image>> ReadImages(const Json& json, const std::string& path,
                                                       size_t index) {
  std::vector<MaterialLibrary::Image> images;
  const auto found = json.find("textures");
  if (found == json.end()) return images;
  const auto wrong = [&](size_t i, const std::string& member) {
    return Fail(fmt::format("{}: {}[{}]{}{} is invalid; correct it, or leave it out.", path,
                            Where(index, "textures"), i, member.empty() ? "" : ".", member));
  };
  if (!found->is_array())
    return Fail(fmt::format("{}: {} must be an array.", path, Where(index, "textures")));
  for (size_t i = 0; i < found->size(); ++i) {
    auto image = ReadImage((*found)[i]);
    if (!image) return wrong(i, image.error().message);
    images.push_back(std::move(*image));
  }
  const auto use_of = [](const MaterialLibrary::Image& image) { return image.binding.use; };
  std::ranges::stable_sort(images, {}, use_of);
  const auto twice = std::ranges::adjacent_find(images, {}, use_of);
  if (twice != images.end())
    return Fail(fmt::format("{}: {} has two textures of one use.", path, Where(index, "textures")));
  return images;
}

Status ReadTexts(const Json& json, const char* key, const std::string& path,
                 std::vector<std::string>& texts) {
  const auto list = json.find(key);
  if (list == json.end()) return {};
  if (!list->is_array()) return Fail(fmt::format("{}: {} must be an array.", path, key));
  for (size_t i = 0; i < list->size(); ++i) {
    if (!(*list)[i].is_string()) return Fail(fmt::format("{}: {}[{}] must be a string.", path, key, i));
    texts.push_back((*list)[i].get<std::string>());
  }
  return {};
}

}  // namespace

MaterialJsonStream::MaterialJsonStream(const std::vector<Material>& materials, std::ostream& out,
                                       const std::vector<std::vector<MaterialLibrary::Image>>& images)
    : out_(out) {
  out_ << "{\"materials\": [";
  const char* separator = "\n  ";
  for (size_t i = 0; i < materials.size(); ++i) {
    Json json = ToJson(materials[i]);
    if (i < images.size())
      for (const MaterialLibrary::Image& image : images[i]) json["textures"].push_back(ToJson(image));
    out_ << separator << Text(json);
    separator = ",\n  ";
  }
  out_ << "],\n\"parts\": [";
}

void MaterialJsonStream::AddPart(const std::string& name) {
  out_ << (first_ ? "\n  " : ",\n  ") << Text(Json(name));
  first_ = false;
}

void MaterialJsonStream::Finish(const std::vector<std::string>& left_out) {
  out_ << ']';
  if (!left_out.empty()) out_ << ",\n\"left_out\": " << Text(Json(left_out));
  out_ << "}\n";
}

void WriteMaterialJson(const MaterialLibrary& library, std::ostream& out) {
  MaterialJsonStream stream(library.materials, out, library.images);
  for (const std::string& part : library.parts) stream.AddPart(part);
  stream.Finish(library.left_out);
}

Result<MaterialLibrary> ReadMaterialJson(const std::string& path) {
  QUARRY_ASSIGN(const Json json, ReadJsonFile<Json>(path, kLimits));
  if (!json.is_object()) return Fail(fmt::format("{}: must hold one JSON object.", path));
  MaterialLibrary library;
  if (const auto materials = json.find("materials"); materials != json.end()) {
    if (!materials->is_array()) return Fail(fmt::format("{}: materials must be an array.", path));
    for (size_t i = 0; i < materials->size(); ++i) {
      QUARRY_ASSIGN(Material material, ReadMaterial((*materials)[i], path, i));
      QUARRY_ASSIGN(auto images, ReadImages((*materials)[i], path, i));
      library.materials.push_back(std::move(material));
      library.images.push_back(std::move(images));
    }
  }
  QUARRY_TRY(ReadTexts(json, "parts", path, library.parts));
  QUARRY_TRY(ReadTexts(json, "left_out", path, library.left_out));
  return library;
}

std::string MaterialJsonPath(const std::string& model_path) {
  const size_t name = model_path.find_last_of('/') + 1;  // npos + 1 is 0: no folder.
  const size_t dot = model_path.find_last_of('.');
  const bool has_extension = dot != std::string::npos && dot > name;
  return (has_extension ? model_path.substr(0, dot) : model_path) + ".materials.json";
}

}  // namespace quarry
