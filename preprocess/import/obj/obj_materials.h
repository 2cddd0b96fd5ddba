#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "preprocess/import/model_sink.h"
#include "preprocess/import/obj/mtl.h"
#include "preprocess/import/warn_once.h"

namespace quarry {

/// The materials that an OBJ file's mtllib lines name, given to the sink when first used. A name defined
/// twice keeps its first meaning. Files not found are warned of once, and so are names not found, and images
/// of the materials used: without theirs the material's own values stand.
class ObjMaterials {
 public:
  ObjMaterials(const std::string& obj_path, ModelSink& sink);

  /// Reads the files named by the rest of an mtllib line: one name that may hold spaces, or several, in which
  /// "\ " stands for a space. Names are relative to the OBJ's folder; backslashes may separate folders, and a
  /// file not found where the name says is looked for beside the OBJ.
  void AddLibraries(std::string_view names);

  /// The scene's index of the material `name`; kNoIndex, the default, if no library read so far has it.
  /// Errors: the sink's.
  Result<uint32_t> Use(std::string_view name);

  /// Which libraries have been read, and which materials the sink has.
  void Save(ByteWriter& out) const;
  /// Reads the libraries again. Errors: one has changed.
  Status Restore(ByteReader& in);

 private:
  struct Entry {
    MtlMaterial material;
    std::string library;  ///< path of its MTL file
    uint32_t scene_index = kNoIndex;
  };

  void AddLibrary(const std::string& name);
  void ReadLibrary(const std::string& path);
  /// The existing file that `name` means, or empty.
  std::filesystem::path Find(const std::string& name) const;
  Status GiveToSink(Entry& entry);
  /// Tells of a file that the model names outside its folder, and that is read all the same.
  void WarnIfOutside(const std::string& by, const std::filesystem::path& file);

  std::string obj_path_;
  ModelSink& sink_;
  WarnOnce warn_;
  std::map<std::string, Entry, std::less<>> entries_;
  std::vector<std::string> read_;  ///< paths of libraries, in the order of their reading
  std::set<std::string> known_;    ///< the same; some exporters name theirs before every object
  bool missing_library_ = false;   ///< a material that is not defined may be of it
};

/// The file names on an mtllib line, blanks escaped by backslashes or not: a name ends at ".mtl" before a
/// blank.
std::vector<std::string> SplitLibraryNames(std::string_view names);

}  // namespace quarry
