#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace quarry {

/// A tree over emitters, by which a vertex chooses one that is strong and near. Its clusters are halves of
/// the emitters along the longest side of their box, down to single ones. From the root on, a vertex goes
/// into either half by its importance: the power over the square of the distance, less where the half lies
/// low over the surface or turns its edge to it, and 0 where it lies below. Units: scene units. Immutable, so
/// thread-safe. The same bits on all machines. Memory: 96 bytes an emitter.
/// Source: Conty Estevez & Kulla 2018, sections 4 and 5.
class EmitterTree {
 public:
  /// A flat surface that shines to both sides.
  struct Emitter {
    glm::vec3 lower, upper;  ///< its box
    glm::vec3 normal;        ///< unit
    double power;            ///< above 0
  };
  EmitterTree() = default;
  /// `by_power`: choices do not depend on the vertex; for tests.
  EmitterTree(std::span<const Emitter> emitters, bool by_power);

  struct Choice {
    uint32_t emitter = 0;
    float chance = 0;  ///< 0: none can light the vertex
  };
  /// An emitter for a vertex. `side`: the unit normal of the side from which light can come, or 0 for both.
  /// `u`: in [0, 1). Requires: there are emitters.
  Choice Choose(const glm::vec3& position, const glm::vec3& side, double u) const;
  /// The chance of Choose() for this emitter.
  float ChanceOf(uint32_t emitter, const glm::vec3& position, const glm::vec3& side) const;

 private:
  /// A cluster in a box. Its normals lie within a cone about `axis` or its opposite. The first half of a
  /// cluster stands behind it, the second half behind the clusters of the first.
  struct Node {
    glm::vec3 middle{0}, half{0}, axis{0};
    float spread = 1;  ///< cosine of the cone's half angle; 0: it holds all directions
    float power = 0;
  };
  struct Cluster {
    glm::vec3 lower, upper, axis;
    double spread_angle, power;
  };
  static Cluster Joined(const Cluster& a, const Cluster& b);
  Cluster Build(std::span<const Emitter> emitters, uint32_t node, uint32_t begin, uint32_t end);
  double Importance(const Node& node, const glm::vec3& position, const glm::vec3& side) const;
  double ShareOfFirst(uint32_t first, uint32_t second, const glm::vec3& position,
                      const glm::vec3& side) const;

  std::vector<Node> nodes_;
  std::vector<uint32_t> order_, place_;  ///< emitters by the tree's leaves; the leaf of each
  bool by_power_ = false;
};

}  // namespace quarry
