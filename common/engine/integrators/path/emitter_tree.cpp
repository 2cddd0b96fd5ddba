#include "common/engine/integrators/path/emitter_tree.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "common/math/elementary.h"

namespace quarry {
namespace {

constexpr double kQuarterTurn = std::numbers::pi / 2;

/// The cosine of a - b, or 1 where b is larger. The angles lie in [0, pi / 2].
double CosineLess(double cosine_a, double cosine_b) {
  if (cosine_a >= cosine_b) return 1;
  return cosine_a * cosine_b +
         std::sqrt(std::max(1 - cosine_a * cosine_a, 0.0) * std::max(1 - cosine_b * cosine_b, 0.0));
}

}  // namespace

EmitterTree::EmitterTree(std::span<const Emitter> emitters, bool by_power)
    : order_(emitters.size()), place_(emitters.size()), by_power_(by_power) {
  if (emitters.empty()) return;
  std::iota(order_.begin(), order_.end(), 0u);
  nodes_.resize(2 * emitters.size() - 1);
  Build(emitters, 0, 0, static_cast<uint32_t>(emitters.size()));
  for (uint32_t i = 0; i < order_.size(); ++i) place_[order_[i]] = i;
}

/// The cone of both clusters lies about the axis between theirs.
EmitterTree::Cluster EmitterTree::Joined(const Cluster& a, const Cluster& b) {
  Cluster joined{glm::min(a.lower, b.lower), glm::max(a.upper, b.upper), a.axis, kQuarterTurn,
                 a.power + b.power};
  const Cluster &wide = a.spread_angle >= b.spread_angle ? a : b, &narrow = &wide == &a ? b : a;
  const glm::dvec3 axis(wide.axis);
  glm::dvec3 other(narrow.axis);
  if (glm::dot(axis, other) < 0) other = -other;
  const glm::dvec3 cross = glm::cross(axis, other);
  const double sine = std::sqrt(glm::dot(cross, cross)), between = ArcTan2(sine, glm::dot(axis, other));
  joined.axis = wide.axis;
  if (between + narrow.spread_angle <= wide.spread_angle) {
    joined.spread_angle = wide.spread_angle;
    return joined;
  }
  const double spread = (wide.spread_angle + between + narrow.spread_angle) / 2;
  if (spread >= kQuarterTurn) return joined;
  double turn_sine = 0, turn_cosine = 1;
  SinCos(spread - wide.spread_angle, turn_sine, turn_cosine);
  const glm::dvec3 across = (other - axis * glm::dot(axis, other)) / std::max(sine, 1e-30);
  joined.axis = glm::vec3(axis * turn_cosine + across * turn_sine);
  joined.spread_angle = spread;
  return joined;
}

/// Sets the node of the emitters [begin, end) of order_, and those below.
EmitterTree::Cluster EmitterTree::Build(std::span<const Emitter> emitters, uint32_t node, uint32_t begin,
                                        uint32_t end) {
  Cluster all{};
  if (end - begin == 1) {
    const Emitter& e = emitters[order_[begin]];
    all = {e.lower, e.upper, e.normal, 0, e.power};
  } else {
    const auto middle_of = [&](uint32_t i) { return emitters[i].lower * 0.5f + emitters[i].upper * 0.5f; };
    glm::vec3 lower(std::numeric_limits<float>::max()), upper = -lower;
    for (uint32_t i = begin; i < end; ++i) {
      lower = glm::min(lower, middle_of(order_[i]));
      upper = glm::max(upper, middle_of(order_[i]));
    }
    const glm::vec3 size = upper * 0.5f - lower * 0.5f;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [&](uint32_t i, uint32_t j) {
                       return std::pair(middle_of(i)[axis], i) < std::pair(middle_of(j)[axis], j);
                     });
    const Cluster first = Build(emitters, node + 1, begin, middle);
    all = Joined(first, Build(emitters, node + 2 * (middle - begin), middle, end));
  }
  double sine = 0, cosine = 1;
  SinCos(all.spread_angle, sine, cosine);
  const glm::vec3 half = all.upper * 0.5f - all.lower * 0.5f;
  nodes_[node] = {all.lower + half, half, all.axis, static_cast<float>(std::max(cosine, 0.0)),
                  static_cast<float>(all.power)};
  return all;
}

/// Of a cluster for a vertex: its power over the square of the distance, times the largest cosines that any
/// of its points and normals can have over the surface and toward the vertex.
double EmitterTree::Importance(const Node& node, const glm::vec3& position, const glm::vec3& side) const {
  const auto power = static_cast<double>(node.power);
  if (by_power_) return power;
  const glm::dvec3 to = glm::dvec3(node.middle) - glm::dvec3(position), half(node.half);
  const glm::dvec3 normal(side);
  const double height = glm::dot(to, normal);
  const bool has_side = side != glm::vec3(0);
  if (has_side && !(height + glm::dot(glm::abs(normal), half) > 0)) return 0;
  const double distance2 = glm::dot(to, to), radius2 = std::max(glm::dot(half, half), 1e-300);
  if (distance2 <= radius2) return power / radius2;
  const double width = std::sqrt(1 - radius2 / distance2), distance = std::sqrt(distance2);
  const double toward = std::fabs(glm::dot(to, glm::dvec3(node.axis))) / distance;
  double share = CosineLess(CosineLess(toward, static_cast<double>(node.spread)), width);
  if (has_side) {
    const double cosine = height / distance;
    // Of a cluster whose middle lies below, the part above is as high as its width lifts it.
    share *= cosine >= 0
                 ? CosineLess(cosine, width)
                 : std::max(cosine * width + std::sqrt((1 - cosine * cosine) * (1 - width * width)), 0.0);
  }
  return power * share / distance2;
}

/// The share of choices that go into the first of two clusters; negative: into neither.
double EmitterTree::ShareOfFirst(uint32_t first, uint32_t second, const glm::vec3& position,
                                 const glm::vec3& side) const {
  const double a = Importance(nodes_[first], position, side), b = Importance(nodes_[second], position, side);
  return a + b > 0 ? a / (a + b) : -1;
}

EmitterTree::Choice EmitterTree::Choose(const glm::vec3& position, const glm::vec3& side, double u) const {
  double chance = 1;
  uint32_t node = 0, begin = 0, end = static_cast<uint32_t>(order_.size());
  while (end - begin > 1) {
    const uint32_t middle = begin + (end - begin) / 2, second = node + 2 * (middle - begin);
    const double share = ShareOfFirst(node + 1, second, position, side);
    if (share < 0) return {};
    const bool is_first = u < share;
    u = is_first ? u / share : (u - share) / (1 - share);
    chance *= is_first ? share : 1 - share;
    node = is_first ? node + 1 : second;
    (is_first ? end : begin) = middle;
  }
  return {order_[begin], static_cast<float>(chance)};
}

float EmitterTree::ChanceOf(uint32_t emitter, const glm::vec3& position, const glm::vec3& side) const {
  double chance = 1;
  uint32_t node = 0, begin = 0, end = static_cast<uint32_t>(order_.size());
  while (end - begin > 1) {
    const uint32_t middle = begin + (end - begin) / 2, second = node + 2 * (middle - begin);
    const double share = ShareOfFirst(node + 1, second, position, side);
    if (share < 0) return 0;
    const bool is_first = place_[emitter] < middle;
    chance *= is_first ? share : 1 - share;
    node = is_first ? node + 1 : second;
    (is_first ? end : begin) = middle;
  }
  return static_cast<float>(chance);
}

}  // namespace quarry
