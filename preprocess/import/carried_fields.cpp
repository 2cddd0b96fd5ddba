#include "preprocess/import/carried_fields.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <vector>

#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

constexpr size_t kMostNames = 64, kMostLetters = 64;  // of a kind, of a name

// The fields that are carried, or that do not change pictures. A star stands for a number.
constexpr std::string_view kPlyElements[] = {"vertex", "face", "tristrips"};
constexpr std::string_view kPlyVertex[] = {"x",           "y",
                                           "z",           "nx",
                                           "ny",          "nz",
                                           "s",           "t",
                                           "u",           "v",
                                           "texture_u",   "texture_v",
                                           "texture_s",   "texture_t",
                                           "red",         "green",
                                           "blue",        "r",
                                           "g",           "b",
                                           "diffuse_red", "diffuse_green",
                                           "diffuse_blue"};
constexpr std::string_view kPlyFace[] = {"vertex_indices",
                                         "vertex_index",
                                         "texcoord",
                                         "texnumber",
                                         "material_index",
                                         "part_index",
                                         "red",
                                         "green",
                                         "blue",
                                         "r",
                                         "g",
                                         "b",
                                         "diffuse_red",
                                         "diffuse_green",
                                         "diffuse_blue"};
// Free forms have a warning of their own.
constexpr std::string_view kObjStatements[] = {
    "v",      "vt",   "vn",   "f",     "fo",  "o",      "g",   "s",     "usemtl", "mtllib",
    "newmtl", "surf", "curv", "curv2", "vp",  "cstype", "deg", "bmat",  "step",   "parm",
    "trim",   "hole", "scrv", "sp",    "end", "con",    "mg",  "ctech", "stech"};
// Quarry has no ambient light of materials (Ka, map_Ka) and no maps of reflections to sharpen. "-d" of
// `illum` counts.
constexpr std::string_view kMtlStatements[] = {"newmtl", "Kd",     "Ks",     "Ke",     "Tf",     "Kr",
                                               "Ns",     "Ni",     "Pm",     "Pr",     "d",      "Tr",
                                               "illum",  "map_Kd", "map_Ks", "map_Ke", "map_d",  "map_bump",
                                               "bump",   "norm",   "map_Kn", "Ka",     "map_Ka", "sharpness"};
constexpr std::string_view kGltfMembers[] = {
    "accessors",      "asset",  "buffers", "bufferViews", "cameras", "extensions", "extensionsRequired",
    "extensionsUsed", "extras", "images",  "materials",   "meshes",  "nodes",      "samplers",
    "scene",          "scenes", "skins",   "textures"};
// Both sides of a surface are seen always.
constexpr std::string_view kGltfMaterial[] = {
    "name",           "extensions", "extras",      "pbrMetallicRoughness", "normalTexture", "emissiveTexture",
    "emissiveFactor", "alphaMode",  "alphaCutoff", "doubleSided"};
// The reader knows which TEXCOORD_n a material uses.
constexpr std::string_view kGltfAttribute[] = {"POSITION", "NORMAL", "COLOR_0", "JOINTS_*", "WEIGHTS_*"};

struct Carried {
  std::string_view kind;  ///< as warnings call it
  std::span<const std::string_view> fields;
};
constexpr Carried kCarried[kFieldKinds] = {
    {"elements", kPlyElements},          {"vertex properties", kPlyVertex},  {"face properties", kPlyFace},
    {"statements", kObjStatements},      {"MTL statements", kMtlStatements}, {"members", kGltfMembers},
    {"material members", kGltfMaterial}, {"attributes", kGltfAttribute},     {"parts", {}},
};

bool Matches(std::string_view carried, std::string_view field) {
  if (!carried.ends_with('*')) return EqualsIgnoringCase(carried, field);
  carried.remove_suffix(1);
  return field.starts_with(carried) && field.size() > carried.size() &&
         field.find_first_not_of("0123456789", carried.size()) == field.npos;
}

}  // namespace

void CarriedFields::Names(FieldKind kind, std::string_view field) {
  const auto carries = [&](FieldKind by) {
    return std::ranges::any_of(kCarried[static_cast<size_t>(by)].fields,
                               [&](std::string_view carried) { return Matches(carried, field); });
  };
  if (carries(kind)) return;
  // An OBJ file may hold its own materials.
  if (kind == FieldKind::kObjStatement && carries(FieldKind::kMtlStatement)) return;
  if (kind == FieldKind::kMtlStatement && carries(FieldKind::kObjStatement)) return;
  std::set<std::string>& names = left_out_[kind];
  if (names.size() < kMostNames) names.emplace(field.substr(0, kMostLetters));
}

std::string CarriedFields::Sentence(const std::string& path) const {
  constexpr size_t kShown = 8;
  std::vector<std::string> kinds;
  for (const auto& [kind, names] : left_out_) {
    std::vector<std::string> shown;
    for (const std::string& name : names)
      if (shown.size() < kShown) shown.push_back(Quoted(name));
    if (names.size() > kShown) shown.push_back("...");
    kinds.push_back(fmt::format("{} {}", kCarried[static_cast<size_t>(kind)].kind, fmt::join(shown, ", ")));
  }
  if (kinds.empty()) return {};
  return fmt::format("{}: left out, since they are not read: {}", path, fmt::join(kinds, "; "));
}

}  // namespace quarry
