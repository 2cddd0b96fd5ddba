#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/ingest/face_resolver.h"
#include "preprocess/ingest/image_list.h"
#include "preprocess/ingest/imported_scene.h"
#include "preprocess/ingest/preview_file.h"
#include "preprocess/ingest/scene_coordinates.h"
#include "preprocess/ingest/scene_tables.h"
#include "preprocess/ingest/triangle_spill.h"

namespace quarry {

/// The sink that a run imports into: model files in, an ImportedScene out. Its parts are
///   SceneCoordinates   placement, scale and offset of positions
///   SceneTables        materials, parts, views, warnings
///   ImageList          images that materials bind
///   FaceResolver       vertices and faces of the current file
///   TriangleSpill      resolved triangles of all files.
/// Large data lies in files "FOLDER/triangles-..." and "FOLDER/import-..."; the first outlive the process.
/// Memory: the streams' pages, batches of faces, windows of `memory` / 4 bytes, and the tables.
/// Thread safety: none; threads of its own resolve faces.
class SpillSink final : public ModelSink {
 public:
  /// Units: memory in bytes; scale multiplies positions, after Place(). `warn` is called with each warning.
  /// Without `textures`, materials get no images. `preview` shows what is read so far. Threads beyond the
  /// importer's and the resolver's help both.
  SpillSink(std::string folder, uint64_t memory, double scale, std::function<void(const std::string&)> warn,
            bool textures = true, std::optional<PreviewFile> preview = {}, unsigned threads = 2);
  SpillSink(const SpillSink&) = delete;

  /// Has the files that begin after this be the roots of their parts.
  void KeepFilesApart() { tables_.KeepFilesApart(); }
  /// Places the files that begin after this. Requires: up_axis is 1 or 2.
  void Place(const Placement& placement, int up_axis) { coordinates_.Place(placement, up_axis); }

  Status BeginFile(std::string_view name) override;
  Status EndFile() override;
  uint32_t AddMaterial(const Material& material) override {
    const uint32_t number = tables_.AddMaterial(material, coordinates_.UnitLength());
    if (Shines(material)) shining_.emplace_back(number, material);
    return number;
  }
  Status SetAlphaLevels(uint32_t material, uint32_t first) override {
    QUARRY_TRY(faces_->Settle());
    triangles_.SetAlphaLevels(material, first);
    return {};
  }
  uint32_t AddPart(std::string_view name, uint32_t parent) override { return tables_.AddPart(name, parent); }
  uint32_t AddSibling(std::string_view name, uint32_t parent) override {
    return tables_.AddSibling(name, parent);
  }
  void SetAttributes(uint32_t part, std::string json) override {
    tables_.SetAttributes(part, std::move(json));
  }
  bool takes_textures() const override { return textures_; }
  Result<uint32_t> AddTexture(TextureImage image) override { return images_.Add(std::move(image)); }
  void AddCamera(NamedCamera camera) override { tables_.AddCamera(std::move(camera), coordinates_); }
  void AddLight(NamedLight light) override { tables_.AddLight(std::move(light), coordinates_); }
  bool WantsOrigin() const override { return !coordinates_.has_offset(); }
  void SetOrigin(const glm::dvec3& place) override { coordinates_.ChooseOffset(coordinates_.Point(place)); }
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddNormal(const glm::vec3& normal) override;
  Status AddUv(const glm::vec2& uv) override;
  Status SetFaceColor(const Rgba8& color) override;
  void SetSmoothing(uint16_t smoothing) override { smoothing_ = SmoothingOfFile(smoothing, file_number_); }
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override;
  WorkTeam* team() override { return &team_; }
  void Warn(std::string message) override { tables_.Warn(std::move(message)); }
  void Note(std::string message) override { tables_.Note(std::move(message)); }
  void HasRead(uint64_t done, uint64_t total) override {
    read_part_ = static_cast<double>(done) / static_cast<double>(std::max<uint64_t>(total, 1));
    if (on_read_) on_read_(done, total);
  }
  /// Calls `on_read` with the bytes read of the current file and its size.
  void OnRead(std::function<void(uint64_t done, uint64_t total)> on_read) { on_read_ = std::move(on_read); }

  /// Writes the import out after the last file and returns a reference to it, a few bytes, for Restore().
  /// Names, materials and the sample may be many: they are written to a file. Errors: disk full.
  Result<Bytes> Save();
  /// Takes over the import that Save() wrote out. With `routed`, the triangles have been routed to regions
  /// since. Requires: no file has begun. Errors: files are absent or differ.
  Status Restore(std::span<const std::byte> saved, bool routed);
  /// Whether the triangles exceed the number that is split in memory.
  bool spills() const { return triangles_.spills(); }

  /// The scene, after the last file. Requires: there was one, and no call has failed. Errors: no triangle is
  /// left; more than 65,536 materials.
  Result<ImportedScene> Finish();

 private:
  Status NoteShining();

  std::string folder_;
  uint64_t memory_;
  bool textures_;
  std::vector<std::pair<uint32_t, Material>> shining_;  ///< materials that triangles_ does not know yet
  uint32_t face_color_ = kWhite;
  uint16_t smoothing_ = kSmoothByAngle;
  uint32_t file_number_ = 0;  ///< of the current file, from 1
  SceneCoordinates coordinates_;
  SceneTables tables_;
  ImageList images_;
  WorkTeam team_;
  TriangleSpill triangles_;
  std::unique_ptr<FaceResolver> faces_;  ///< the current file's; absent between files
  std::function<void(uint64_t, uint64_t)> on_read_;
  std::optional<PreviewFile> preview_;
  double read_part_ = 0;  ///< of the file's bytes
  uint32_t unshown_ = 0;  ///< polygons since the last look at the clock
};

}  // namespace quarry
