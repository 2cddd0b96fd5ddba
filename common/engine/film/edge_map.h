#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "common/engine/edge_grid.h"

namespace quarry {

/// The pixels of a tile on which thin dark lines are drawn: where parts or normals meet, and where a surface
/// ends before another. A line depends on the surfaces at the centres of a pixel and its four neighbours
/// alone, so that it is the same for any tiles and crops. Not thread-safe.
/// Memory: 36 bytes a place of the grid.
class EdgeMap {
 public:
  /// The share of light that is left on a line.
  static constexpr float kLine = 0.3f;

  /// Begins a tile. Without `edges` no pixel has a line, and no memory is used.
  void Open(const Tile& tile, bool edges);
  const EdgeGrid& grid() const { return grid_; }
  /// The surface at a place; a place without one has none. `t`: from the eye.
  void Set(uint32_t place, uint32_t part, const glm::vec3& normal, const glm::vec3& position, float t) {
    seen_[place] = {part, t, normal, position};
  }
  /// Finds the lines. Call when all places are set.
  void Finish();
  /// Whether lines are drawn at all.
  bool any() const { return !on_line_.empty(); }
  /// The factor of a point's light.
  float Factor(uint32_t pixel) const { return on_line_[pixel] ? kLine : 1.0f; }
  size_t memory_bytes() const { return seen_.size() * sizeof(Seen) + on_line_.size(); }

 private:
  static constexpr uint32_t kNothing = 0xFFFFFFFFu;
  struct Seen {
    uint32_t part = kNothing;
    float t = 0;
    glm::vec3 normal{0}, position{0};
  };
  static bool IsLine(const Seen& here, const Seen& there, bool follows);

  EdgeGrid grid_;
  uint32_t columns_ = 0, rows_ = 0;
  std::vector<Seen> seen_;
  std::vector<uint8_t> on_line_;  ///< by point
};

}  // namespace quarry
