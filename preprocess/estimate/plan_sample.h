#pragma once

#include <algorithm>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/ignoring_sink.h"
#include "preprocess/preprocess.h"
#include "preprocess/spill/triangle_record.h"

// What a model's triangles take, told from parts of it that are built as a run builds all: cubes around some
// of its vertices, with everything that reaches into them.

namespace quarry {

/// Vertices spread evenly over a file.
class VertexSample {
 public:
  void Add(const glm::dvec3& position);
  const std::vector<glm::dvec3>& points() const { return points_; }

 private:
  static constexpr size_t kMost = 1 << 16;
  std::vector<glm::dvec3> points_;
  uint64_t next_ = 0, step_ = 1;
};

/// A cube; infinite for one that holds everything.
struct SampleWindow {
  glm::dvec3 centre{0};
  double half_side = 0;

  bool Holds(const glm::dvec3& p) const;
};

/// Cubes around vertices from all over a file of so many triangles, each with a share of the vertices that
/// stands for as many triangles as a region has; for a small file one that holds everything.
std::vector<SampleWindow> ChooseWindows(const VertexSample& vertices, uint64_t triangles);

/// The triangles of the `file`-th file that have a corner in a window. Faces that come before their vertices
/// are not seen.
class WindowSink : public IgnoringSink {
 public:
  struct Vertex {
    glm::dvec3 position{0};
    Rgba8 color;
    uint32_t windows = 0;  ///< that hold it, as bits
  };
  struct Triangle {
    Corner corners[3];
    uint32_t id, material, part;
    uint32_t windows, owners;  ///< that hold a corner, the first corner
  };
  WindowSink(size_t file, std::span<const SampleWindow> windows, uint64_t vertices);

  Status BeginFile(std::string_view) override;
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override;

  const std::vector<Triangle>& triangles() const { return triangles_; }
  /// Null for a vertex that lies in no window.
  const Vertex* Find(uint32_t index) const;

 private:
  struct Numbered {
    uint32_t index;
    Vertex vertex;
  };
  bool here() const { return begun_ == file_ + 1; }

  size_t file_, begun_ = 0;
  std::span<const SampleWindow> windows_;
  std::vector<bool> inside_;        ///< by vertex
  std::vector<Numbered> vertices_;  ///< ascending
  std::vector<Triangle> triangles_;
  uint32_t next_ = 0, next_id_ = 0;
};

/// Some of the elements of a stream.
template <class Element>
class Picked {
 public:
  /// `indices`: which; in any order, each as often as it comes.
  explicit Picked(std::vector<uint32_t> indices) : indices_(std::move(indices)) {
    std::ranges::sort(indices_);
    indices_.erase(std::unique(indices_.begin(), indices_.end()), indices_.end());
  }
  bool wants_any() const { return !indices_.empty(); }
  /// The next element of the stream.
  void Offer(const Element& element) {
    if (elements_.size() < indices_.size() && indices_[elements_.size()] == next_)
      elements_.push_back(element);
    ++next_;
  }
  /// Null for one that was not picked, or has not come.
  const Element* Find(uint32_t index) const {
    const auto at = static_cast<size_t>(std::ranges::lower_bound(indices_, index) - indices_.begin());
    return at < elements_.size() && indices_[at] == index ? &elements_[at] : nullptr;
  }

 private:
  std::vector<uint32_t> indices_;
  std::vector<Element> elements_;
  uint32_t next_ = 0;
};

/// What else the corners of those triangles have: positions beyond all windows, normals, texture coordinates.
class CornerSink : public IgnoringSink {
 public:
  CornerSink(size_t file, const WindowSink& windows);
  Status BeginFile(std::string_view) override;
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override;
  Status AddNormal(const glm::vec3& normal) override;
  Status AddUv(const glm::vec2& uv) override;

  /// Whether there is anything to read the models for.
  bool wants_any() const { return beyond_.wants_any() || normals_.wants_any() || uvs_.wants_any(); }
  /// All of the triangle but its vertices, which are `positions` as the model has them. False for one with
  /// corners that do not exist.
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

/// What a triangle takes: of building, with as many threads as a run has, and of the store; and a byte of its
/// record, in spill files; in how many regions it lies.
struct SampleCost {
  double seconds = 0, bytes = 0, spilled = 0.5, references = 1.05;
};
/// Where too little is known.
inline constexpr SampleCost kUsualCost{3e-6, 13};
inline constexpr uint64_t kFewestTriangles = 1000;  ///< that tell something

/// Builds voxels of what is in the windows; where they hold too little, what a triangle took in the scenes
/// measured. `vertices`: those that windows were chosen from.
Result<SampleCost> MeasureWindows(const PreprocessOptions& options, std::span<const SampleWindow> windows,
                                  const VertexSample& vertices, const WindowSink& content,
                                  const CornerSink& corners, Attributes attributes);

}  // namespace quarry
