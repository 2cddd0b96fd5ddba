#include "preprocess/import/obj/obj_materials.h"

#include <fmt/format.h>

#include "preprocess/import/files/find_file.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

std::string_view WithoutQuotes(std::string_view name) {
  const bool quoted = name.size() >= 2 && name.front() == '"' && name.back() == '"';
  return quoted ? name.substr(1, name.size() - 2) : name;
}

bool EndsLibraryName(std::string_view name) {
  if (name.ends_with('"')) name.remove_suffix(1);
  return name.size() >= 4 && EqualsIgnoringCase(name.substr(name.size() - 4), ".mtl");
}

}  // namespace

std::vector<std::string> SplitLibraryNames(std::string_view names) {
  std::vector<std::string> result;
  std::string name;
  for (size_t i = 0; i < names.size(); ++i) {
    const bool escaped = names[i] == '\\' && i + 1 < names.size() && names[i + 1] == ' ';
    if (escaped) ++i;
    if (escaped || !IsBlank(names[i]) || (!name.empty() && !EndsLibraryName(name))) {
      name += names[i];
    } else if (!name.empty()) {
      result.emplace_back(WithoutQuotes(name));
      name.clear();
    }
  }
  if (!name.empty()) result.emplace_back(WithoutQuotes(name));
  return result;
}

ObjMaterials::ObjMaterials(const std::string& obj_path, ModelSink& sink)
    : obj_path_(obj_path), sink_(sink), warn_(sink) {}

void ObjMaterials::AddLibraries(std::string_view names) {
  const std::string whole(WithoutQuotes(names));
  if (!Find(whole).empty()) return AddLibrary(whole);
  for (const std::string& name : SplitLibraryNames(names)) AddLibrary(name);
}

void ObjMaterials::AddLibrary(const std::string& name) {
  fs::path path = Find(name);
  if (path.empty()) {
    path = FindOnlyFile(obj_path_, name, {".mtl"});
    if (!path.empty())
      warn_(fmt::format("{}: the material file {} is not there; the only one beside it is read: {}",
                        obj_path_, Quoted(name), path.string()));
  }
  if (path.empty()) {
    missing_library_ = true;
    return warn_(fmt::format("{}: the material file {} is not there", obj_path_, Quoted(name)));
  }
  WarnIfOutside(obj_path_, path);
  ReadLibrary(path.string());
}

void ObjMaterials::AddOwn() { ReadLibrary(obj_path_); }

void ObjMaterials::WarnIfOutside(const std::string& by, const fs::path& file) {
  if (LeavesFolder(obj_path_, file))
    warn_(fmt::format("{}: names the file {}, outside the model's folder; it is read anyway", by,
                      file.string()));
}

void ObjMaterials::ReadLibrary(const std::string& path) {
  if (!known_.insert(path).second) return;
  auto materials = ReadMtl(path, [this](const std::string& message) { warn_(message); });
  if (!materials) return warn_(materials.error().message);
  for (MtlMaterial& material : *materials) {
    std::string key = material.material.name;
    entries_.try_emplace(std::move(key), Entry{std::move(material), path});
  }
}

fs::path ObjMaterials::Find(const std::string& name) const { return FindFile(obj_path_, name); }

Result<uint32_t> ObjMaterials::Use(std::string_view name) {
  const auto found = entries_.find(name);
  if (found == entries_.end()) {
    if (missing_library_) return kNoIndex;  // already warned of
    warn_(fmt::format("{}: the material {} is not defined; the default is used", obj_path_, Quoted(name)));
    return kNoIndex;
  }
  Entry& entry = found->second;
  if (entry.scene_index == kNoIndex) QUARRY_TRY(GiveToSink(entry));
  return entry.scene_index;
}

Status ObjMaterials::GiveToSink(Entry& entry) {
  Material& material = entry.material.material;
  for (const MtlTexture& texture : entry.material.textures) {
    if (!sink_.takes_textures()) break;
    fs::path file = FindFile(entry.library, texture.file);
    if (file.empty()) {
      file = FindOnlyFile(entry.library, texture.file,
                          {".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff"});
      if (!file.empty())
        warn_(fmt::format("{}, line {}: the image {} is not there; the only one beside it is read: {}",
                          entry.library, texture.line, Quoted(texture.file), file.string()));
    }
    if (file.empty()) {
      warn_(fmt::format("{}, line {}: the image {} is not there; the material does without it", entry.library,
                        texture.line, Quoted(texture.file)));
      continue;
    }
    WarnIfOutside(entry.library, file);
    TextureImage image;
    image.file = file.string();
    image.name = texture.file;
    image.model = entry.library;
    image.color = texture.color;
    image.pick = texture.pick;
    material.textures.push_back(Bounded(texture.binding));
    QUARRY_ASSIGN(material.textures.back().texture, sink_.AddTexture(std::move(image)));
  }
  entry.scene_index = sink_.AddMaterial(material);
  return {};
}

}  // namespace quarry
