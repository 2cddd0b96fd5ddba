#include "preprocess/import/ply/ply_tables.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <filesystem>

#include "common/scene/material_json.h"
#include "common/voxel/parts/part_path.h"
#include "preprocess/import/carried_fields.h"
#include "preprocess/import/files/find_file.h"
#include "preprocess/import/ply/library_textures.h"
#include "preprocess/import/ply/ply_textures.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {

std::string PlyTables::LibraryPath() const {
  std::string path =
      MaterialJsonPath(is_packed_ ? std::filesystem::path(path_).replace_extension().string() : path_);
  const auto found = FindFile(path_, std::filesystem::path(path).filename().string());
  return found.empty() ? path : found.string();
}

Status PlyTables::LoadLibrary(const PlyPlan& face) {
  const bool has_materials = face.Has(kMaterial, kMaterial), has_parts = face.Has(kPart, kPart);
  if (!has_materials && !has_parts) return {};
  const std::string path = LibraryPath();
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) {
    sink_.Warn(fmt::format("{}: has material_index or part_index, but {} is not there, so they are left out",
                           path_, path));
    return {};
  }
  QUARRY_ASSIGN(const MaterialLibrary library, ReadMaterialJson(path));
  CarriedFields left_out;
  for (const std::string& field : library.left_out) left_out.Names(FieldKind::kForeign, field);
  const std::string& model = model_.empty() ? path_ : model_;
  left_out.Warn(model, sink_);
  materials.wanted = has_materials;
  for (size_t i = 0; has_materials && i < library.materials.size(); ++i) {
    Material material = library.materials[i];
    QUARRY_TRY(AddLibraryTextures(library.images[i], path, model, sink_, material));
    materials.scene_index.push_back(sink_.AddMaterial(material));
  }
  parts.wanted = has_parts && !library.parts.empty();
  for (const std::string& part : library.parts)
    if (has_parts) parts.scene_index.push_back(PartOf(part));
  return {};
}

/// The part of a path; its ancestors are parts too.
uint32_t PlyTables::PartOf(const std::string& path) {
  uint32_t part = kNoIndex;
  for (const std::string& name : NamesOfPath(path)) part = sink_.AddPart(name, part);
  return part;
}

Status PlyTables::LoadTextures(const PlyHeader& header, bool has_uvs) {
  if (header.texture_files.empty() || materials.wanted) return {};
  if (!has_uvs) {
    sink_.Warn(fmt::format("{}: names the image {} (TextureFile), but has no texture coordinates", path_,
                           Quoted(header.texture_files.front())));
    return {};
  }
  QUARRY_ASSIGN(textures.scene_index, AddPlyTextures(header, path_, sink_));
  textures.wanted = !textures.scene_index.empty();
  return {};
}

}  // namespace quarry
