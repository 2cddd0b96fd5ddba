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

// Estimates a run from some of the regions that it would make. A region is chosen with the probability of its
// share of the triangles, so dense places, and places crossed by many triangles, count as often as they cost.

namespace quarry {

/// An array in pages: growing copies nothing, so it takes only its own memory. Thread safety: none.
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

/// Resolves triangles as a run does, from vertices held in memory. Triangles whose corners come later in the
/// file are skipped. Gives up when vertices exceed `memory` bytes: held_all() is false. Thread safety: none.
class ResolvingSink : public IgnoringSink {
 public:
  /// Units: memory in bytes. `attributes`: also hold normals, texture coordinates and colours.
  ResolvingSink(const PreprocessOptions& options, uint64_t memory, bool attributes)
      : options_(options), memory_(memory), attributes_(attributes), coordinates_(options.scale) {}

  /// Places the next file. Requires: no file has begun.
  void Place(const std::string& model) {
    coordinates_.Place(PlacementOf(options_, model), static_cast<int>(PlacedAbout(options_)));
  }
  Status BeginFile(std::string_view) override;
  bool WantsOrigin() const override { return !coordinates_.has_offset(); }
  void SetOrigin(const glm::dvec3& place) override { coordinates_.ChooseOffset(coordinates_.Point(place)); }
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddNormal(const glm::vec3& normal) override;
  Status AddUv(const glm::vec2& uv) override;
  Status SetFaceColor(const Rgba8& color) override;
  void SetSmoothing(uint16_t smoothing) override { smoothing_ = smoothing; }
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override;
  /// Whether memory held the vertices of every file.
  bool held_all() const { return !gave_up_; }
  /// Frees the vertices after the last model.
  void Release() { (void)ResolvingSink::BeginFile(""); }

 protected:
  /// Receives a triangle that a run would keep.
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
  std::vector<TriangleRecord> fan_;  ///< triangles of the current polygon
  PolygonFan polygon_;
  uint32_t face_color_ = 0xFFFFFFFFu;
  uint16_t smoothing_ = kSmoothByAngle;
  uint32_t next_id_ = 0;
};

/// Triangles of the models, from a first pass.
struct TriangleSurvey {
  TriangleSample sample;
  Box bounds{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  uint64_t triangles = 0;  ///< resolved, and kept by a run
};

/// The regions of a run, and the choice of those to build.
struct PlannedRegions {
  Region whole;
  RegionTree tree;
  float padding = 0;
  std::vector<uint32_t> chosen;    ///< indices of regions, ascending
  std::vector<uint32_t> weights;   ///< how often each chosen region was chosen
  std::vector<uint64_t> expected;  ///< triangles of every region, by the sample
};
/// Plans the regions of a run over the surveyed models and chooses some to build. Takes the survey's sample.
PlannedRegions PlanRegions(TriangleSurvey& survey);
/// Bytes that a RegionSink writes for the chosen regions, about.
uint64_t KeptBytes(const PlannedRegions& regions, Attributes attributes);

/// Routes all triangles to regions as a run does, and keeps the chosen regions' triangles in files in
/// `folder`. Thread safety: none.
class RegionSink : public ResolvingSink {
 public:
  RegionSink(const PreprocessOptions& options, uint64_t memory, PlannedRegions& regions,
             Attributes attributes, std::string folder);
  /// Builds the kept triangles and computes the cost of a triangle from them. Errors: disk full.
  Result<SampleCost> Measure();

 protected:
  Status Take(const TriangleRecord& record) override;

 private:
  /// A chosen region's triangles.
  struct Kept {
    std::optional<SpillFile> file;
    uint64_t every = 1;  ///< keeps each n-th run of triangles
  };
  Result<double> SpilledShare();
  Result<double> BuildRegion(size_t kept);

  const PreprocessOptions& options_;
  PlannedRegions& regions_;
  const Attributes attributes_;
  const std::string folder_;
  std::vector<uint64_t> counts_;  ///< triangles of every region
  std::vector<Box> contents_;
  std::vector<uint32_t> kept_of_;  ///< index in kept_ of every region, or kNoIndex
  std::vector<Kept> kept_;
  uint64_t taken_ = 0;
};

}  // namespace quarry
