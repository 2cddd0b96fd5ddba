#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/kdtree/build.h"
#include "common/kdtree/ray.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/spill_file.h"
#include "preprocess/triangle_record.h"

namespace quarry {

/// Everything the importers gave, ready for the partition.
struct ImportedScene {
  std::optional<SpillFile> triangles;  ///< TriangleRecords of RecordBytes(has_shading), in input order
  bool has_shading = false;
  glm::dvec3 offset{0};  ///< taken off every position, after scaling
  Box bounds{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  uint64_t input_triangles = 0;
  uint64_t dropped_degenerate = 0;
  uint64_t dropped_not_finite = 0;
  std::vector<Material> materials;  ///< at least one
  std::vector<std::string> parts;   ///< at least one
  std::vector<std::string> warnings;
};

/// The importers' sink: writes vertices, attributes and faces to spill files, and resolves the indices of
/// each file when it ends, by as many sequential passes as there are windows of the vertices that fit in
/// memory; never by random access. A model far from the origin is brought near it, so that floats hold its
/// positions. Degenerate and non-finite triangles are dropped and counted; their ids
/// stay used.
class SpillSink final : public ModelSink {
 public:
  /// At most about `memory` bytes are held while a file is resolved. Positions are multiplied by `scale`.
  /// `warn` is called with each warning.
  SpillSink(std::string folder, uint64_t memory, double scale, std::function<void(const std::string&)> warn);

  Status BeginFile(std::string_view name) override;
  Status EndFile() override;
  uint32_t AddMaterial(const Material& material) override;
  uint32_t AddPart(std::string_view name) override;
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddNormal(const glm::vec3& normal) override;
  Status AddUv(const glm::vec2& uv) override;
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override;
  void Warn(std::string message) override;

  /// After the last file. Requires: no error before.
  Result<ImportedScene> Finish();

 private:
  struct Face;
  Status PrepareTriangles();
  Status Resolve();
  void ChooseOffset(const glm::dvec3& first);
  Status KeepTriangle(const TriangleRecord& record);
  uint32_t DefaultMaterial();

  std::string folder_;
  uint64_t memory_;
  double scale_;
  std::function<void(const std::string&)> warn_;
  std::string file_name_;
  uint32_t file_part_ = kNoIndex;
  std::unordered_map<std::string, uint32_t> file_parts_;  ///< names of the current file
  std::optional<SpillFile> positions_, normals_, uvs_, faces_;
  uint32_t default_material_ = kNoIndex;
  bool has_offset_ = false;
  ImportedScene scene_;
};

}  // namespace quarry
