#pragma once

#include <algorithm>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/ignoring_sink.h"
#include "preprocess/preprocess_options.h"
#include "preprocess/spill/triangle_record.h"

// Estimates a run from cubes of the model, which are built as a run builds everything: cubes around some of
// its vertices, with every triangle that has a corner in them.

namespace quarry {

/// A sample of a file's vertices, evenly spread over their order. Thread safety: none.
class VertexSample {
 public:
  void Add(const glm::dvec3& position);
  const std::vector<glm::dvec3>& points() const { return points_; }

 private:
  static constexpr size_t kMost = 1 << 16;
  std::vector<glm::dvec3> points_;
  uint64_t next_ = 0, step_ = 1;
};

/// A cube in model coordinates; an infinite cube holds everything.
struct SampleWindow {
  glm::dvec3 centre{0};
  double half_side = 0;

  bool Holds(const glm::dvec3& p) const;
};

/// Chooses cubes around vertices from all over a file of `triangles` triangles. Each holds a share of the
/// sampled vertices that stands for the triangles of one region. A small file gets one infinite cube.
std::vector<SampleWindow> ChooseWindows(const VertexSample& vertices, uint64_t triangles);

/// Collects the triangles of file number `file` that have a corner in a cube. Faces that come before their
/// vertices are skipped. Thread safety: none.
class WindowSink : public IgnoringSink {
 public:
  struct Vertex {
    glm::dvec3 position{0};
    Rgba8 color;
    uint32_t windows = 0;  ///< bit i: cube i holds the vertex
  };
  struct Triangle {
    Corner corners[3];
    uint32_t id, material, part;
    uint16_t smoothing;
    uint32_t windows, owners;  ///< bits of the cubes that hold a corner, and that hold the first corner
  };
  WindowSink(size_t file, std::span<const SampleWindow> windows, uint64_t vertices);

  Status BeginFile(std::string_view) override;
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  void SetSmoothing(uint16_t smoothing) override { smoothing_ = smoothing; }
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override;

  const std::vector<Triangle>& triangles() const { return triangles_; }
  /// Null: the vertex lies in no cube.
  const Vertex* Find(uint32_t index) const;

 private:
  struct Numbered {
    uint32_t index;
    Vertex vertex;
  };
  bool here() const { return begun_ == file_ + 1; }

  size_t file_, begun_ = 0;
  std::span<const SampleWindow> windows_;
  std::vector<bool> inside_;        ///< of each vertex of the file
  std::vector<Numbered> vertices_;  ///< ascending by index
  std::vector<Triangle> triangles_;
  uint32_t next_ = 0, next_id_ = 0;
  uint16_t smoothing_ = kSmoothByAngle;
};

/// Elements picked from a stream by their indices.
template <class Element>
class Picked {
 public:
  /// `indices`: in any order, repeated or not.
  explicit Picked(std::vector<uint32_t> indices) : indices_(std::move(indices)) {
    std::ranges::sort(indices_);
    indices_.erase(std::unique(indices_.begin(), indices_.end()), indices_.end());
  }
  bool wants_any() const { return !indices_.empty(); }
  /// Receives the stream's next element.
  void Offer(const Element& element) {
    if (elements_.size() < indices_.size() && indices_[elements_.size()] == next_)
      elements_.push_back(element);
    ++next_;
  }
  /// Null: the element was not picked, or has not come.
  const Element* Find(uint32_t index) const {
    const auto at = static_cast<size_t>(std::ranges::lower_bound(indices_, index) - indices_.begin());
    return at < elements_.size() && indices_[at] == index ? &elements_[at] : nullptr;
  }

 private:
  std::vector<uint32_t> indices_;
  std::vector<Element> elements_;
  uint32_t next_ = 0;
};

/// Collects the other data of those triangles' corners: positions outside all cubes, normals, texture
/// coordinates. Thread safety: none.
class CornerSink : public IgnoringSink {
 public:
  CornerSink(size_t file, const WindowSink& windows);
  Status BeginFile(std::string_view) override;
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddNormal(const glm::vec3& normal) override;
  Status AddUv(const glm::vec2& uv) override;

  /// Whether a pass over the models is needed at all.
  bool wants_any() const { return beyond_.wants_any() || normals_.wants_any() || uvs_.wants_any(); }
  /// Fills in `triangle`, except its vertices, which go to `positions` in model coordinates. False: a corner
  /// does not exist.
  bool Resolve(const WindowSink::Triangle& triangle, glm::dvec3 (&positions)[3],
               TriangleRecord& record) const;

 private:
  bool here() const { return begun_ == file_ + 1; }

  size_t file_, begun_ = 0;
  const WindowSink& windows_;
  Picked<WindowSink::Vertex> beyond_;
  Picked<glm::vec3> normals_;
  Picked<glm::vec2> uvs_;
};

/// Cost of a triangle.
/// Units: seconds of building with all of the run's threads; bytes of store; packed bytes a byte of spilled
/// record; regions that it lies in.
struct SampleCost {
  double seconds = 0, bytes = 0, spilled = 0.5, references = 1.05;
};
/// Used where the model tells too little: the mean of measured scenes.
inline constexpr SampleCost kUsualCost{3e-6, 13};
inline constexpr uint64_t kFewestTriangles = 1000;  ///< fewer triangles tell too little

/// Builds voxels from the triangles in the cubes. With too few triangles, returns kUsualCost. `vertices`: the
/// sample that the cubes were chosen from. Errors: a model cannot be read.
Result<SampleCost> MeasureWindows(const PreprocessOptions& options, std::span<const SampleWindow> windows,
                                  const VertexSample& vertices, const WindowSink& content,
                                  const CornerSink& corners, Attributes attributes);

}  // namespace quarry
