#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/ingest/checkpointed_sink.h"
#include "preprocess/ingest/face_resolver.h"
#include "preprocess/ingest/image_list.h"
#include "preprocess/ingest/imported_scene.h"
#include "preprocess/ingest/scene_coordinates.h"
#include "preprocess/ingest/scene_tables.h"
#include "preprocess/ingest/triangle_spill.h"

namespace quarry {

/// The sink that a run imports into: model files in, an ImportedScene out. Its parts are
///   SceneCoordinates   placement, scale and offset of positions
///   SceneTables        materials, parts, views, warnings
///   ImageList          images that materials bind
///   FaceResolver       vertices and faces of the current file
///   TriangleSpill      resolved triangles of all files
///   ImportCheckpoints  state from which a later process continues.
/// Large data lies in files "FOLDER/triangles-..." and "FOLDER/import-...", which outlive the process.
/// Memory: the streams' pages, batches of faces, windows of `memory` / 4 bytes, and the tables.
/// Thread safety: none; a second thread of its own resolves faces.
class SpillSink final : public CheckpointedSink {
 public:
  /// Units: memory in bytes; scale multiplies positions, after Place(). `warn` is called with each warning.
  /// Without `textures`, materials get no images.
  SpillSink(std::string folder, uint64_t memory, double scale, std::function<void(const std::string&)> warn,
            bool textures = true);
  SpillSink(const SpillSink&) = delete;

  /// Places the files that begin after this. Requires: up_axis is 1 or 2.
  void Place(const Placement& placement, int up_axis) { coordinates_.Place(placement, up_axis); }

  Status BeginFile(std::string_view name) override;
  Status EndFile() override;
  uint32_t AddMaterial(const Material& material) override {
    return tables_.AddMaterial(material, coordinates_.UnitLength());
  }
  Status SetAlphaLevels(uint32_t material, uint32_t first) override {
    QUARRY_TRY(faces_->Settle());
    triangles_.SetAlphaLevels(material, first);
    return {};
  }
  uint32_t AddPart(std::string_view name) override { return tables_.AddPart(name); }
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
  void Warn(std::string message) override { tables_.Warn(std::move(message)); }
  void Note(std::string message) override { tables_.Note(std::move(message)); }
  bool CheckpointDue() override { return checkpoints_.Due(elements()); }
  bool HasAll() const override { return faces_->waiting().has_all(); }

  /// Makes the import so far durable and returns a reference to it, a few bytes, for Restore(). Names,
  /// materials and the sample may be many: they are written to a file. Errors: disk full.
  Result<Bytes> Save();
  /// Continues where Save() was called. With `routed`, Save() came after the last file and the triangles have
  /// been routed to regions since. Requires: no file has begun. Errors: files are absent or differ.
  Status Restore(std::span<const std::byte> saved, bool routed);
  /// Whether a file has begun and not ended; after Restore(), the first file to begin is that file.
  bool in_file() const { return faces_ != nullptr; }
  /// Whether the triangles exceed the number that is split in memory.
  bool spills() const { return triangles_.spills(); }

  /// The scene, after the last file. Requires: there was one, and no call has failed. Errors: no triangle is
  /// left; more than 65,536 materials.
  Result<ImportedScene> Finish();

 private:
  uint64_t elements() const { return faces_->vertices().positions() + triangles_.input_triangles(); }

  std::string folder_;
  uint64_t memory_;
  bool textures_;
  uint32_t face_color_ = kWhite;
  uint16_t smoothing_ = kSmoothByAngle;
  uint32_t file_number_ = 0;  ///< of the current file, from 1
  SceneCoordinates coordinates_;
  SceneTables tables_;
  ImageList images_;
  TriangleSpill triangles_;
  std::unique_ptr<FaceResolver> faces_;  ///< the current file's; absent between files
};

}  // namespace quarry
