#pragma once

#include <bit>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// The smooth normal of a triangle's corner. `triangle`: its number in CornerFans.
struct CornerNormal {
  uint32_t triangle = 0;
  uint32_t corner = 0;
  uint32_t normal = 0;  ///< packed, see PackNormal()
};

/// A hash of a position; 0 and -0 are one position.
inline uint32_t HashOfPosition(const glm::vec3& position) {
  uint64_t hash = 0;
  for (int a = 0; a < 3; ++a)
    hash = (hash ^ std::bit_cast<uint32_t>(position[a] + 0.0f)) * 0x9E3779B97F4A7C15ull;
  hash ^= hash >> 29;
  return static_cast<uint32_t>((hash * 0xBF58476D1CE4E5B9ull) >> 32);
}

/// The corners that meet at positions, and their smooth normals. A corner's normal is the mean of the unit
/// normals of those triangles at its position that its own triangle meets smoothly, weighted by their angles
/// there. Triangles meet smoothly when they share a smoothing group; without groups, when the angle between
/// their planes is at most the crease angle, whichever side faces outwards. Positions with equal coordinates
/// are one position. Positions with more than kMostAround corners stay flat. Memory: about 40 bytes a corner.
/// Thread safety: none. Source: Thürmer & Wüthrich, Computing Vertex Normals from Polygonal Facets, 1998.
class CornerFans {
 public:
  /// The time of a fan grows with the square of its corners.
  static constexpr uint32_t kMostAround = 512;

  /// Units: degrees.
  explicit CornerFans(double crease);
  void Clear();
  /// Makes room for the corners of so many triangles.
  void Reserve(size_t triangles) {
    faces_.reserve(triangles);
    corners_.reserve(3 * triangles);
  }

  /// Makes an empty fan at a position, unless there is one. Returns: how often it has been opened. `hash`,
  /// here and below: HashOfPosition().
  uint32_t Open(const glm::vec3& position, uint32_t hash) { return ++opened_[SlotOf(position, hash)]; }
  bool Has(const glm::vec3& position, uint32_t hash) const { return table_[Probe(position, hash)] != kFree; }
  bool empty() const { return positions_.empty(); }
  size_t corners() const { return corners_.size(); }
  /// Adds a corner to the fan at its position. Requires: IsSmoothed(t); the corners of a triangle are added
  /// one after the other.
  void Add(const TriangleRecord& t, uint32_t triangle, uint32_t corner, uint32_t hash);

  /// The normals of corners that differ visibly from their triangle's normal, in any order.
  std::vector<CornerNormal> Solve() const;

 private:
  static constexpr uint32_t kFree = 0xFFFFFFFFu;
  struct Face {
    glm::vec3 normal;  ///< of unit length
    float angles[3];   ///< in radians
    uint32_t triangle;
    uint16_t smoothing;
  };
  struct PlacedCorner {
    uint32_t slot;
    uint32_t face_corner;  ///< four times the face, and the corner
  };
  uint32_t SlotOf(const glm::vec3& position, uint32_t hash);
  /// The place in the table of a position, or of the free slot where it belongs.
  size_t Probe(const glm::vec3& position, uint32_t hash) const {
    // Multiplied, because the hashes of a pass share their low bits.
    size_t at = (hash * 0x9E3779B1u) >> table_shift_;
    while (table_[at] != kFree && positions_[table_[at]] != position) at = (at + 1) & (table_.size() - 1);
    return at;
  }
  void Grow();
  static Face MakeFace(const TriangleRecord& t, uint32_t triangle);
  void SolveFan(std::span<const uint32_t> fan, std::vector<CornerNormal>& normals) const;

  float smooth_cosine_;
  std::vector<uint32_t> table_;  ///< slots by hash of position, open addressing
  int table_shift_ = 0;          ///< 32 minus the bits of a place in the table
  std::vector<glm::vec3> positions_;
  std::vector<uint32_t> opened_;  ///< times, of each slot
  std::vector<uint32_t> counts_;  ///< corners of each slot, corners beyond kMostAround included
  std::vector<Face> faces_;
  std::vector<PlacedCorner> corners_;
};

}  // namespace quarry
