#pragma once

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
#include "preprocess/image_list.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/paged_file.h"
#include "preprocess/regions.h"
#include "preprocess/sample.h"
#include "preprocess/spill_file.h"
#include "preprocess/triangle_record.h"

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
  std::vector<TextureImage> images;  ///< that bindings of the materials name; all lie in files
};

/// Where a model is put: scaled, turned counter-clockwise about the up axis, moved.
struct Placement {
  double scale = 1, turn_degrees = 0;
  glm::dvec3 translation{0};
};

/// The importers' sink. Vertices go to paged files; a triangle is resolved as it comes, when its corners lie
/// in pages at hand or worth loading. Those that wait (their vertices are far apart, or come later) are
/// resolved when the file ends, by as many sequential passes as there are windows of the vertices that fit in
/// memory; never by random access. A model far from the origin is brought near it, so that floats hold its
/// positions. Degenerate and non-finite triangles are dropped and counted; their ids stay used.
class SpillSink final : public ModelSink {
 public:
  /// Triangles go to files "FOLDER/triangles-..." with a name, which outlive the process; `memory`: bytes
  /// that windows may take. Positions are multiplied by `scale`, after what Place says. `warn` is called with
  /// each warning. Without `textures` materials get none.
  SpillSink(std::string folder, uint64_t memory, double scale, std::function<void(const std::string&)> warn,
            bool textures = true);

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
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddNormal(const glm::vec3& normal) override;
  Status AddUv(const glm::vec2& uv) override;
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override;
  void Warn(std::string message) override;

  /// Between files: makes the triangles outlast a loss of power, and returns what Restore needs to go on from
  /// here.
  Result<Bytes> Save();
  /// Before the first file: goes on where Save was called. With `sample_again` triangles are cut to those,
  /// and read once to sample them; else they may be gone already. Errors: the triangles are not there.
  Status Restore(std::span<const std::byte> saved, bool sample_again);
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
  };
  std::string TrianglesPath() const;
  Status OpenTriangles();
  Status Found(Attributes attributes);
  Status Settle();
  Status HandOver();
  Status ResolveBatch();
  bool ResolveFromMemory(const Face& face, TriangleRecord& record);
  Status LoadPages(const Face& face);
  Status ResolveWaiting();
  void ChooseOffset(const glm::dvec3& first);
  Status KeepTriangle(const TriangleRecord& record);
  uint32_t DefaultMaterial();

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
  uint32_t file_part_ = kNoIndex;
  std::unordered_map<std::string, uint32_t> file_parts_;  ///< names of the current file
  std::optional<PagedFile> positions_, normals_, uvs_;
  std::optional<SpillFile> waiting_;
  /// Faces are resolved in batches by another thread, which alone touches what follows, scene_'s triangles
  /// and the pages while one is under way.
  std::vector<Face> gathered_, batch_;
  std::future<Status> under_way_;
  uint32_t loads_left_ = 0, faces_to_next_load_ = 0;
  uint32_t default_material_ = kNoIndex;
  bool has_offset_ = false, saved_ = false;
  ImportedScene scene_;
};

}  // namespace quarry
