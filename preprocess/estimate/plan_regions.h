#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/estimate/plan_sample.h"
#include "preprocess/ingest/polygon_fan.h"
#include "preprocess/ingest/scene_coordinates.h"
#include "preprocess/partition/regions.h"
#include "preprocess/spill/spill_file.h"

// What a model's triangles take, told from some of the regions that a run would make, chosen with the chance
// of their triangles: what is dense, or crossed by many triangles, is met as often as it costs.

namespace quarry {

/// Elements by their number; growing never copies them, so that memory is what they take.
template <class T>
class Numbered {
 public:
  void Add(const T& value) {
    if (size_ % kPage == 0) pages_.push_back(std::make_unique<T[]>(kPage));
    pages_[size_ / kPage][size_ % kPage] = value;
    ++size_;
  }
  size_t size() const { return size_; }
  const T& operator[](size_t i) const { return pages_[i / kPage][i % kPage]; }
  void Clear() {
    pages_.clear();
    size_ = 0;
  }

 private:
  static constexpr size_t kPage = 1 << 15;
  std::vector<std::unique_ptr<T[]>> pages_;
  size_t size_ = 0;
};

/// Holds the vertices of the file at hand, as far as `memory` bytes go, and makes triangles of them as a run
/// does. Triangles whose corners come after them are passed over.
class ResolvingSink : public IgnoringSink {
 public:
  /// `attributes`: whether normals, texture coordinates and colours are wanted too.
  ResolvingSink(const PreprocessOptions& options, uint64_t memory, bool attributes)
      : options_(options), memory_(memory), attributes_(attributes), coordinates_(options.scale) {}

  /// The next file's. Before it begins.
  void Place(const std::string& model) {
    coordinates_.Place(PlacementOf(options_, model), static_cast<int>(options_.up_axis));
  }
  Status BeginFile(std::string_view) override;
  bool WantsOrigin() const override { return !coordinates_.has_offset(); }
  void SetOrigin(const glm::dvec3& place) override { coordinates_.ChooseOffset(coordinates_.Point(place)); }
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddNormal(const glm::vec3& normal) override;
  Status AddUv(const glm::vec2& uv) override;
  Status SetFaceColor(const Rgba8& color) override;
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override;
  /// Whether the memory did for every file.
  bool held_all() const { return !gave_up_; }
  /// Frees the vertices, once all models have been read.
  void Release() { (void)ResolvingSink::BeginFile(""); }

 protected:
  /// A triangle that a run would keep.
  virtual Status Take(const TriangleRecord& record) = 0;

 private:
  bool Resolve(const Corner (&corners)[3], TriangleRecord& record) const;
  void Hold(uint64_t bytes);

  const PreprocessOptions& options_;
  const uint64_t memory_;
  const bool attributes_;
  uint64_t held_ = 0;  ///< bytes
  bool gave_up_ = false;
  SceneCoordinates coordinates_;
  Numbered<glm::vec3> positions_, normals_;
  Numbered<uint32_t> colors_;
  Numbered<glm::vec2> uvs_;
  std::vector<TriangleRecord> fan_;  ///< of the polygon at hand
  PolygonFan polygon_;
  uint32_t face_color_ = 0xFFFFFFFFu;
  uint32_t next_id_ = 0;
};

/// What a first pass over the models tells of their triangles.
struct TriangleSurvey {
  TriangleSample sample;
  Box bounds{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  uint64_t triangles = 0;  ///< resolved, and kept by a run
};

/// Some regions, with their triangles.
struct PlannedRegions {
  Region whole;
  RegionTree tree;
  float padding = 0;
  std::vector<uint32_t> chosen;    ///< regions, ascending
  std::vector<uint32_t> weights;   ///< of those: how often each was chosen
  std::vector<uint64_t> expected;  ///< triangles of every region, by the sample
};
/// The regions of a run over these models, and which of them are to be built.
PlannedRegions PlanRegions(TriangleSurvey& survey);
/// Bytes that a RegionSink writes for them, about.
uint64_t KeptBytes(const PlannedRegions& regions, Attributes attributes);

/// Routes all triangles to the regions as a run does, and keeps those of the chosen ones in files in
/// `folder`.
class RegionSink : public ResolvingSink {
 public:
  RegionSink(const PreprocessOptions& options, uint64_t memory, PlannedRegions& regions,
             Attributes attributes, std::string folder);
  /// Builds what was kept, and reckons from it. Errors: disk full.
  Result<SampleCost> Measure();

 protected:
  Status Take(const TriangleRecord& record) override;

 private:
  /// A chosen region's.
  struct Kept {
    std::optional<SpillFile> file;
    uint64_t every = 1;  ///< of so many runs of triangles one is kept
  };
  Result<double> SpilledShare();
  Result<double> BuildRegion(size_t kept);

  const PreprocessOptions& options_;
  PlannedRegions& regions_;
  const Attributes attributes_;
  const std::string folder_;
  std::vector<uint64_t> counts_;  ///< of every region
  std::vector<Box> contents_;
  std::vector<uint32_t> kept_of_;  ///< of every region its place in kept_, or kNoIndex
  std::vector<Kept> kept_;
  uint64_t taken_ = 0;
};

}  // namespace quarry
