#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <glm/mat3x3.hpp>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/base/bytes.h"
#include "common/kdtree/build.h"
#include "common/kdtree/ray.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/ingest/image_list.h"
#include "preprocess/ingest/polygon_fan.h"
#include "preprocess/partition/regions.h"
#include "preprocess/partition/sample.h"
#include "preprocess/spill/paged_file.h"
#include "preprocess/spill/spill_file.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Everything the importers gave, ready for the partition.
struct ImportedScene {
  std::optional<SpillFile> triangles;  ///< TriangleRecords of RecordBytes(attributes), in input order
  TriangleSample sample;               ///< of them
  Attributes attributes = Attributes::kNone;
  glm::dvec3 offset{0};  ///< taken off every position, after scaling
  Box bounds{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  uint64_t input_triangles = 0;
  uint64_t dropped_degenerate = 0;
  uint64_t dropped_not_finite = 0;
  std::vector<Material> materials;  ///< at least one
  std::vector<std::string> parts;   ///< at least one
  std::vector<std::string> warnings;
  SceneViews views;
  std::vector<TextureImage> images;  ///< that bindings of the materials name; all lie in files
};

/// Where a model is put: scaled, turned counter-clockwise about the up axis, moved.
struct Placement {
  double scale = 1, turn_degrees = 0;
  glm::dvec3 translation{0};
};

/// What multiplies a placed model's positions.
glm::dmat3 TurnOf(const Placement& placement, int up_axis);
/// What is taken off all positions, by one in their midst: axes on which it lies far out are moved by whole
/// steps. Nothing: it is no place.
std::optional<glm::dvec3> OffsetFor(const glm::dvec3& place);

/// The importers' sink. Vertices go to paged files; a triangle is resolved as it comes, when its corners lie
/// in pages at hand or worth loading. Those that wait (their vertices are far apart, or come later) are
/// resolved when the file ends, by as many sequential passes as there are windows of the vertices that fit in
/// memory; never by random access. A model far from the origin is brought near it, so that floats hold its
/// positions. Degenerate and non-finite triangles are dropped and counted; their ids stay used.
/// All of it lies in files "FOLDER/triangles-..." and "FOLDER/import-...", which outlive the process, so that
/// another can go on from the last note.
class SpillSink final : public ModelSink {
 public:
  /// `memory`: bytes that windows may take. Positions are multiplied by `scale`, after what Place says.
  /// `warn` is called with each warning. Without `textures` materials get none.
  SpillSink(std::string folder, uint64_t memory, double scale, std::function<void(const std::string&)> warn,
            bool textures = true);

  /// So many seconds after the last note, `note` is called in the middle of a file, and between passes over
  /// many faces that wait: it keeps what Save gives, where a later process finds it. Without this, none is
  /// made.
  void NoteEvery(double seconds, std::function<Status()> note);

  /// As a file is read, `told` is called with the bytes read of it, and those that it has.
  void OnRead(std::function<void(uint64_t done, uint64_t total)> told) { on_read_ = std::move(told); }

  /// For the files that begin after this. `up_axis`: 1 or 2.
  void Place(const Placement& placement, int up_axis);

  ~SpillSink() override;
  SpillSink(const SpillSink&) = delete;

  Status BeginFile(std::string_view name) override;
  Status EndFile() override;
  uint32_t AddMaterial(const Material& material) override;
  uint32_t AddPart(std::string_view name) override;
  bool takes_textures() const override { return textures_; }
  Result<uint32_t> AddTexture(TextureImage image) override { return images_.Add(std::move(image)); }
  void AddCamera(NamedCamera camera) override;
  void AddLight(NamedLight light) override;
  bool WantsOrigin() const override { return !has_offset_; }
  void SetOrigin(const glm::dvec3& place) override;
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddNormal(const glm::vec3& normal) override;
  Status AddUv(const glm::vec2& uv) override;
  Status SetFaceColor(const Rgba8& color) override;
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override;
  void Warn(std::string message) override;
  void HasRead(uint64_t done, uint64_t total) override {
    if (on_read_) on_read_(done, total);
  }
  void ReadsOnce() override { reads_once_ = true; }
  bool CheckpointDue() override;
  Status Checkpoint(const Bytes& state) override;
  std::span<const std::byte> LastCheckpoint() const override { return importer_state_; }
  bool HasAll() const override { return has_all_; }

  /// Makes what came so far outlast a loss of power, and returns what Restore needs to go on from here: a few
  /// bytes. Names and materials may be many: they and the sample are written to one of two files by turns.
  Result<Bytes> Save();
  /// What Save returned last is on disk: gives back the files that only earlier notes speak of.
  void Noted();
  /// Whether a note must follow before the next file begins, or the triangles are read.
  bool must_note() const { return !superseded_.empty(); }
  /// Before the first file: goes on where Save was called. With `all` it was called after the last file, and
  /// the triangles have been handed out since: they may be gone. Errors: files are not there.
  Status Restore(std::span<const std::byte> saved, bool all);
  /// Whether what was restored lies within a file, which then is the first to begin.
  bool in_file() const { return positions_.has_value(); }
  /// Whether there are more triangles than are split in memory.
  bool spills() const { return scene_.triangles && scene_.triangles->count() > kMostInMemory; }

  /// After the last file. Requires: no error before.
  Result<ImportedScene> Finish();

 private:
  /// One triangle with its indices not yet resolved.
  struct Face {
    Corner corners[3];
    uint32_t id = 0;
    uint32_t material = 0;
    uint32_t part = 0;
    uint32_t color = 0xFFFFFFFFu;  ///< in place of its corners', if it has one
    uint32_t following = 0;        ///< triangles of the same polygon's fan
  };
  struct StoredPosition {
    glm::vec3 position;
    uint32_t color;
  };
  std::function<void(uint64_t, uint64_t)> on_read_;
  std::string FilePath(const char* stream) const;
  std::string TrianglesPath() const;
  Status Note();
  std::string PartialPath(int number) const;
  std::string StatePath() const;
  void RemoveStale() const;
  Status SaveFile(ByteWriter& out);
  Status RestoreFile(ByteReader& in);
  Result<SpillFile> OpenTrianglesFile(uint64_t count);
  Status OpenTriangles();
  Status Found(Attributes attributes);
  Status Settle();
  Status HandOver();
  Status ResolveBatch();
  Result<bool> ResolveFace(const Face& face, TriangleRecord& record);
  Status KeepPolygon();
  bool ResolveFromMemory(const Face& face, TriangleRecord& record);
  Status LoadPages(const Face& face);
  Status ResolveWaiting();
  Status ResolveWindow(uint64_t window, bool last);
  glm::dvec3 InScene(const glm::dvec3& position) const;
  void ChooseOffset(const glm::dvec3& place);
  void WarnOfLoss();
  Status KeepTriangle(const TriangleRecord& record);
  uint32_t DefaultMaterial();
  glm::dvec3 Turned(const glm::dvec3& direction) const;
  template <class View>
  void Keep(View view, bool sane, size_t most, std::vector<View>& views);

  std::string folder_;
  uint64_t memory_;
  double scale_;
  glm::dmat3 turn_{1};  ///< and the placement's scale
  glm::dvec3 translation_{0};
  bool placed_ = false;
  std::function<void(const std::string&)> warn_;
  bool textures_;
  ImageList images_;
  std::string file_name_;
  uint32_t file_part_ = kNoIndex;                         ///< the part of the current file's own name
  uint32_t first_part_ = 0, first_warning_ = 0;           ///< of the current file
  std::unordered_map<std::string, uint32_t> file_parts_;  ///< names of the current file
  std::optional<PagedFile> positions_, normals_, uvs_;
  std::optional<SpillFile> waiting_;
  /// Of resolving those that wait: elements in the windows before, and what they gave.
  bool has_all_ = false;
  uint64_t resolved_ = 0;
  std::optional<SpillFile> partial_;
  uint8_t partial_number_ = 0;
  std::vector<Face> gathered_;
  /// Faces are resolved in batches by another thread: while one is under way it alone touches the batch, the
  /// pages, what may be loaded, and of scene_ triangles, sample, bounds and what was dropped.
  std::vector<Face> batch_;
  std::future<Status> under_way_;
  std::vector<TriangleRecord> fan_;  ///< of the polygon that is being resolved
  PolygonFan polygon_;
  uint32_t face_color_ = 0xFFFFFFFFu;
  uint32_t loads_left_ = 0, faces_to_next_load_ = 0;
  uint32_t default_material_ = kNoIndex;
  bool has_offset_ = false;
  double largest_loss_ = 0;  ///< of a coordinate, by its rounding to a float
  ImportedScene scene_;
  SpillWriter writer_;  ///< of its triangles: ends before them

  double note_seconds_ = 0;
  std::function<Status()> note_;
  std::chrono::steady_clock::time_point noted_at_ = std::chrono::steady_clock::now();
  uint64_t asked_at_ = 0;  ///< elements given when CheckpointDue last looked at the clock
  bool reads_once_ = false, goes_on_ = false;
  Bytes importer_state_;
  bool warned_of_views_ = false;
  bool noted_ = false, file_noted_ = false;  ///< ever; within the current file
  uint8_t state_number_ = 0;
  std::vector<SpillFile> superseded_;
};

}  // namespace quarry
