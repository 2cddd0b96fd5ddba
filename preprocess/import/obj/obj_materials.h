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

/// The materials of an OBJ file's mtllib lines, given to the sink on first use. A name defined twice keeps
/// its first meaning. A missing file, a missing name, and a missing image of a used material give one warning
/// each; without its image the material's own values apply. Thread safety: none.
class ObjMaterials {
 public:
  ObjMaterials(const std::string& obj_path, ModelSink& sink);

  /// Reads the libraries of an mtllib line: one name that may hold spaces, or several, in which "\ " is a
  /// space. Names are relative to the OBJ's folder, with slashes or backslashes; a missing file is looked for
  /// beside the OBJ.
  void AddLibraries(std::string_view names);
  /// Reads the materials that stand in the OBJ itself. Requires: it can be opened again.
  void AddOwn();

  /// The scene's index of the material `name`; kNoIndex (the default material) if no library so far has it.
  /// Errors: the sink's.
  Result<uint32_t> Use(std::string_view name);

 private:
  struct Entry {
    MtlMaterial material;
    std::string library;  ///< path of its MTL file
    uint32_t scene_index = kNoIndex;
  };

  void AddLibrary(const std::string& name);
  void ReadLibrary(const std::string& path);
  /// The existing file that `name` means; empty: none.
  std::filesystem::path Find(const std::string& name) const;
  Status GiveToSink(Entry& entry);
  /// Warns of a file that the model names outside its folder; it is read all the same.
  void WarnIfOutside(const std::string& by, const std::filesystem::path& file);

  std::string obj_path_;
  ModelSink& sink_;
  WarnOnce warn_;
  std::map<std::string, Entry, std::less<>> entries_;
  std::set<std::string>
      known_;  ///< paths of the libraries read; some exporters repeat the line before every object
  bool missing_library_ = false;  ///< a missing material may be defined in it
};

/// The file names on an mtllib line, with blanks escaped by backslashes or not: a name ends at ".mtl" before
/// a blank.
std::vector<std::string> SplitLibraryNames(std::string_view names);

}  // namespace quarry
