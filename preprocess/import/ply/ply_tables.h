#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/model_reader.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/import/ply/ply_plan.h"

namespace quarry {

/// Maps the values of a property of faces to indices in the scene.
struct IndexTable {
  bool wanted = false;  ///< the file has the property, and its list is there
  std::vector<uint32_t> scene_index;

  /// The index in the scene of a row's value; kNoIndex if the table is not wanted. False: it lists no such
  /// value.
  bool Look(double value, uint32_t& index) const {
    index = kNoIndex;
    if (!wanted) return true;
    const auto at = static_cast<size_t>(value >= 0 && value < 0x1p32 ? value : 0x1p32);
    if (at >= scene_index.size() || static_cast<double>(at) != value) return false;
    index = scene_index[at];
    return true;
  }
};

/// The lists that a PLY's faces refer to: materials and parts in a file of its own, images in the header.
/// Thread safety: const functions.
class PlyTables {
 public:
  /// `model` was converted to this PLY; empty: none. The arguments must outlive the tables.
  PlyTables(const ModelReader& bytes, const std::string& model, ModelSink& sink)
      : path_(bytes.path()), model_(model), is_packed_(bytes.is_packed()), sink_(sink) {}

  /// Reads the file of materials and parts, if faces have such properties. Errors: of that file.
  Status LoadLibrary(const PlyPlan& face);
  /// Registers the header's images, unless materials name theirs. Errors: of the images.
  Status LoadTextures(const PlyHeader& header, bool has_uvs);
  /// The file of materials and parts; for "model.ply.gz" that of "model.ply".
  std::string LibraryPath() const;

  IndexTable materials, parts;
  IndexTable textures;  ///< materials of the images that the header names

 private:
  uint32_t PartOf(const std::string& path);

  const std::string& path_;
  const std::string& model_;
  const bool is_packed_;
  ModelSink& sink_;
};

}  // namespace quarry
