#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/ingest/imported_scene.h"
#include "preprocess/ingest/scene_coordinates.h"

namespace quarry {

/// Collects a scene's materials, parts, cameras, lights and warnings over all model files. Memory grows with
/// their number, not with the triangles. Thread safety: none.
class SceneTables {
 public:
  static constexpr uint32_t kMostMaterials = 65536;

  /// `warn` is called with each new warning.
  explicit SceneTables(std::function<void(const std::string&)> warn) : warn_(std::move(warn)) {}

  /// Starts a model file; parts from here on are the file's.
  void BeginFile(std::string_view name);
  const std::string& file_name() const { return file_name_; }
  const std::vector<Material>& materials() const { return tables_.materials; }

  /// From here on each file is the root of its parts. Before the first file.
  void KeepFilesApart() { files_apart_ = true; }

  /// Each returns the index in the scene. See ModelSink for parts; one that would lie too deep (FORMAT.md) is
  /// put beside its parent. `unit_length`: scene length of a unit of the material's lengths.
  uint32_t AddMaterial(const Material& material, double unit_length = 1);
  uint32_t AddPart(std::string_view name, uint32_t parent);
  uint32_t AddSibling(std::string_view name, uint32_t parent);
  void SetAttributes(uint32_t part, std::string json);
  /// The material of faces without a material, added on first use.
  uint32_t DefaultMaterial();
  /// The part of faces without a part, named after the file, added on first use.
  uint32_t FilePart();

  /// Adds a view in scene coordinates, under a name of its own. A view beyond the store's limit, or with
  /// numbers that are not usable, is left out with a warning.
  void AddCamera(NamedCamera camera, const SceneCoordinates& coordinates);
  void AddLight(NamedLight light, const SceneCoordinates& coordinates);

  void Warn(std::string message);
  void Note(std::string message) { tables_.notes.push_back(std::move(message)); }

  void Save(ByteWriter& out) const;
  /// Bytes that end too early make `in` not ok().
  void Restore(ByteReader& in);
  /// After the last file. Errors: more than 65,536 materials.
  Status Finish();
  ImportedTables Take() { return std::move(tables_); }

 private:
  /// Parts by parent and name. The number is the last that was added to the name to keep siblings apart.
  struct Named {
    uint32_t part, number = 1;
  };
  using PartsByName = std::unordered_map<std::string, Named>;

  uint32_t ParentFor(uint32_t parent);
  std::pair<PartsByName::iterator, bool> Add(PartsByName& parts, std::string_view name, uint32_t parent);
  uint32_t AddApart(PartsByName& parts, std::string_view name, uint32_t parent);
  uint32_t FileRoot();
  template <class View>
  void AddView(View view, size_t most, std::vector<View>& views);

  std::function<void(const std::string&)> warn_;
  ImportedTables tables_;
  uint32_t default_material_ = kNoIndex;
  std::string file_name_;
  uint32_t file_part_ = kNoIndex;
  bool files_apart_ = false;
  PartsByName file_parts_;  ///< of the current file
  PartsByName files_;       ///< roots of files that are kept apart
  bool warned_of_views_ = false;
  bool warned_of_attributes_ = false;
};

}  // namespace quarry
