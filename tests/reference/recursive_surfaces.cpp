#include "tests/reference/recursive_surfaces.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <numbers>

namespace quarry::test {
namespace {

constexpr double kPi = std::numbers::pi;
/// Width of GGX below which a layer is a mirror, as path_bsdf.h states.
constexpr double kMirrorWidth = 0.002;
/// Nodes of a table by direction. They lie closer where light grazes.
constexpr int kNodes = 256;

/// GGX: facets a solid angle, of a facet at this cosine to the normal. Source: Walter et al. 2007, equation
/// 33.
double FacetsAt(double cosine, double width) {
  const double cosine2 = cosine * cosine, tangent2 = (1 - cosine2) / cosine2, root = width * width + tangent2;
  return width * width / (kPi * cosine2 * cosine2 * root * root);
}

/// Smith's ratio of hidden to seen facets. Source: Heitz 2014, equation 72.
double Hidden(double cosine, double width) {
  const double tangent2 = (1 - cosine * cosine) / (cosine * cosine);
  return (std::sqrt(1 + width * width * tangent2) - 1) / 2;
}

/// The share of facets that two directions see. Source: Heitz 2014, equation 99 (correlated by height).
double SeenByBoth(double a, double b, double width) { return 1 / (1 + Hidden(a, width) + Hidden(b, width)); }

double Mean(const glm::dvec3& v) { return (v.x + v.y + v.z) / 3; }

/// The share of light that the terminator leaves. Source: Chiang et al. 2019, equation 3.
double BeforeTerminator(double geometric, double shading, double between) {
  const double g = std::min(geometric / (shading * between), 1.0);
  return -g * g * g + g * g + g;
}

}  // namespace

double BoundaryShare(double cosine, double index) {
  const double sine = std::sqrt(std::max(1 - cosine * cosine, 0.0)) / index;
  if (sine >= 1) return 1;
  const double behind = std::sqrt(1 - sine * sine);
  const double across = (cosine - index * behind) / (cosine + index * behind);
  const double along = (index * cosine - behind) / (index * cosine + behind);
  return (across * across + along * along) / 2;
}

/// With u in [0, 1), tan^2 = width^2 u / (1 - u) spreads facets evenly by their projected area, which takes
/// the distribution out of the integral.
LayerShares::LayerShares(double roughness, double index) : mirrors_(kNodes), boundary_(kNodes) {
  constexpr int kSteps = 96, kTurns = 48;
  const double width = std::max(roughness * roughness, 1e-4);
  for (int node = 0; node < kNodes; ++node) {
    const double root = static_cast<double>(std::max(node, 1)) / (kNodes - 1), cosine = root * root;
    const double sine = std::sqrt(std::max(1 - cosine * cosine, 0.0));
    for (int i = 0; i < kSteps; ++i) {
      const double u = (i + 0.5) / kSteps, height = 1 / std::sqrt(1 + width * width * u / (1 - u));
      const double aside = std::sqrt(1 - height * height);
      for (int j = 0; j < kTurns; ++j) {
        const double turn = kPi * (j + 0.5) / kTurns;  // the other half is its mirror image
        const double toward = sine * aside * std::cos(turn) + cosine * height;
        const double light = 2 * toward * height - cosine;
        if (toward <= 0 || light <= 0) continue;
        const double share = SeenByBoth(cosine, light, width) * toward / (cosine * height);
        mirrors_[static_cast<size_t>(node)] += share / (kSteps * kTurns);
        boundary_[static_cast<size_t>(node)] += share * BoundaryShare(toward, index) / (kSteps * kTurns);
      }
    }
  }
}

double LayerShares::Between(const std::vector<double>& nodes, double cosine) {
  const double place = std::sqrt(std::clamp(cosine, 0.0, 1.0)) * (kNodes - 1);
  const auto node = std::min(static_cast<size_t>(place), size_t{kNodes - 2});
  const double off = place - static_cast<double>(node);
  return nodes[node] * (1 - off) + nodes[node + 1] * off;
}

glm::dvec3 MirroredView(const Meeting& at) {
  glm::dvec3 mirrored = at.normal * (2 * glm::dot(at.normal, at.view)) - at.view;
  const double inward = std::min(glm::dot(mirrored, at.side), 0.0);
  mirrored -= at.side * (2 * inward);
  return glm::normalize(mirrored);
}

namespace {

/// The mean of a boundary's share over a hemisphere, by the cosine.
double MeanShare(double index) {
  constexpr int kSteps = 64;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double cosine = (i + 0.5) / kSteps;
    sum += 2 * cosine * BoundaryShare(cosine, index) / kSteps;
  }
  return sum;
}

}  // namespace

OpaqueSurface::OpaqueSurface(const Material& m, const LayerShares& shares, const Meeting& at)
    : at_(at),
      width_(static_cast<double>(m.specular_roughness) * static_cast<double>(m.specular_roughness)),
      index_(m.specular_ior),
      view_cosine_(std::max(glm::dot(at.normal, at.view), 1e-4)),
      is_mirror_(width_ < kMirrorWidth) {
  const glm::dvec3 other = std::fabs(at.normal.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  across_ = glm::normalize(glm::cross(at.normal, other));
  along_ = glm::cross(at.normal, across_);
  const double metalness = m.base_metalness;
  const glm::dvec3 base = glm::min(glm::dvec3(m.base_color) * at.color, glm::dvec3(1));
  metal_ = base * metalness;
  metal_edge_ = (glm::dvec3(1) - base) * metalness;
  layer_ = glm::dvec3(m.specular_color) * (static_cast<double>(m.specular_weight) * (1 - metalness));
  // Light that facets do not send back at once meets others, at all angles: each time they reflect their mean
  // share. Source: Turquin 2019, equation 16, with the mean of Kulla & Conty 2017.
  const double once = is_mirror_ ? 1 : shares.OfMirrors(view_cosine_);
  again_ = glm::dvec3(1) + (metal_ + metal_edge_ / 21.0 + layer_ * MeanShare(index_)) * ((1 - once) / once);
  const double of_layer = is_mirror_ ? BoundaryShare(view_cosine_, index_) : shares.OfBoundary(view_cosine_);
  body_ = base * (glm::dvec3(1) - glm::min(layer_ * again_ * of_layer, glm::dvec3(1))) * (1 - metalness);
  const bool has_layer = Mean(metal_ + metal_edge_ + layer_) > 0, has_body = Mean(body_) > 0;
  layer_odds_ = has_layer ? (has_body ? 0.5 : 1) : 0;
}

/// The share of light that a facet reflects: metals by Schlick's curve, the layer as a boundary.
glm::dvec3 OpaqueSurface::Facets(double cosine) const {
  return metal_ + metal_edge_ * std::pow(std::max(1 - cosine, 0.0), 5) +
         layer_ * BoundaryShare(cosine, index_);
}

glm::dvec3 OpaqueSurface::Scattered(const glm::dvec3& light) const {
  const double cosine = glm::dot(light, at_.normal), geometric = glm::dot(light, at_.side);
  if (!(cosine > 0) || !(geometric > 0)) return glm::dvec3(0);
  glm::dvec3 scattered = body_ * (cosine / kPi);
  if (!is_mirror_ && layer_odds_ > 0) {
    const glm::dvec3 half = glm::normalize(light + at_.view);
    const double height = glm::dot(half, at_.normal);
    if (height > 0)
      scattered += Facets(glm::dot(half, at_.view)) * again_ *
                   (FacetsAt(height, width_) * SeenByBoth(view_cosine_, cosine, width_) / (4 * view_cosine_));
  }
  return scattered * BeforeTerminator(geometric, cosine, glm::dot(at_.side, at_.normal));
}

/// Of the direction to which a facet mirrors the viewer.
double OpaqueSurface::HalfDensity(const glm::dvec3& half) const {
  const double height = glm::dot(half, at_.normal), toward = glm::dot(half, at_.view);
  return height > 0 && toward > 0 ? FacetsAt(height, width_) * height / (4 * toward) : 0;
}

double OpaqueSurface::Density(const glm::dvec3& light) const {
  const double cosine = std::max(glm::dot(light, at_.normal), 0.0);
  const double layer = is_mirror_ ? 0 : HalfDensity(glm::normalize(light + at_.view));
  return (1 - layer_odds_) * cosine / kPi + layer_odds_ * layer;
}

OpaqueSurface::Step OpaqueSurface::Next(Numbers& numbers) const {
  const bool layer = numbers.Next() < layer_odds_;
  if (layer && is_mirror_) return {MirroredView(at_), Facets(view_cosine_) / layer_odds_, 0};
  const double u = numbers.Next(), turn = 2 * kPi * numbers.Next();
  const double height = layer ? 1 / std::sqrt(1 + width_ * width_ * u / (1 - u)) : std::sqrt(1 - u);
  const double aside = std::sqrt(std::max(1 - height * height, 0.0));
  Step step;
  step.direction = ToWorld(aside * std::cos(turn), aside * std::sin(turn), height);
  if (layer) {
    const double toward = glm::dot(step.direction, at_.view);
    if (!(toward > 0)) return {};
    step.direction = glm::normalize(step.direction * (2 * toward) - at_.view);
  }
  step.density = Density(step.direction);
  if (!(step.density > 0)) return {};
  step.weight = Scattered(step.direction) / step.density;
  return step;
}

}  // namespace quarry::test
