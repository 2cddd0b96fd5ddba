#include "preprocess/smooth/corner_fans.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>

#include "common/math/elementary.h"
#include "common/math/packed_normal.h"

namespace quarry {
namespace {

constexpr size_t kSmallestTable = 1 << 12;
constexpr double kPi = 3.14159265358979323846;
constexpr float kTurnedCosine = -0.5f;  // facets at a larger angle are two sides of a sheet or spike
// A sum that is this much smaller than its terms has no direction: the smoothing group closes on itself.
constexpr float kLeastShare = 0.01f;
// A normal within 0.15 degrees of its triangle's is left out: the difference is less than a grey level of 8
// bits.
constexpr float kFlatCosine = 1 - 3.5e-6f;

/// The arc cosine, to 7e-5 radians. Source: Abramowitz & Stegun, 4.4.45.
double ArcCosine(double x) {
  const double a = std::min(std::fabs(x), 1.0);
  const double arc = std::sqrt(1 - a) * (1.5707288 + a * (-0.2121144 + a * (0.0742610 + a * -0.0187293)));
  return x < 0 ? kPi - arc : arc;
}

constexpr size_t kLanes = 8;
using Float8 = float __attribute__((vector_size(32)));
using Int8 = int32_t __attribute__((vector_size(32)));
constexpr Int8 kLaneNumbers{0, 1, 2, 3, 4, 5, 6, 7};

template <class Vector, class T>
Vector Load(const T* values) {
  Vector vector;
  std::memcpy(&vector, values, sizeof vector);
  return vector;
}

double Dot(const glm::dvec3& a, const glm::dvec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

}  // namespace

CornerFans::CornerFans(double crease) {
  double sine, cosine;
  SinCos(crease * (kPi / 180), sine, cosine);
  // Facets of a cylinder that meet at exactly the crease angle differ by rounding.
  smooth_cosine_ = static_cast<float>(cosine) - 1e-5f;
  Clear();
}

void CornerFans::Clear() {
  table_.assign(std::max(table_.size(), kSmallestTable), kFree);
  table_shift_ = 33 - std::bit_width(table_.size());
  positions_.clear();
  opened_.clear();
  counts_.clear();
  faces_.clear();
  corners_.clear();
}

uint32_t CornerFans::SlotOf(const glm::vec3& position, uint32_t hash) {
  size_t at = Probe(position, hash);
  if (table_[at] != kFree) return table_[at];
  if (2 * positions_.size() >= table_.size()) {
    Grow();
    at = Probe(position, hash);
  }
  table_[at] = static_cast<uint32_t>(positions_.size());
  positions_.push_back(position);
  opened_.push_back(0);
  counts_.push_back(0);
  return table_[at];
}

void CornerFans::Grow() {
  table_.assign(2 * table_.size(), kFree);
  --table_shift_;
  for (uint32_t slot = 0; slot < positions_.size(); ++slot)
    table_[Probe(positions_[slot], HashOfPosition(positions_[slot]))] = slot;
}

CornerFans::Face CornerFans::MakeFace(const TriangleRecord& t, uint32_t triangle) {
  const glm::dvec3 p[3] = {glm::dvec3(t.vertices[0]), glm::dvec3(t.vertices[1]), glm::dvec3(t.vertices[2])};
  const glm::dvec3 a = p[1] - p[0], b = p[2] - p[0], c = p[2] - p[1];
  const double aa = Dot(a, a), bb = Dot(b, b), cc = Dot(c, c);
  const double first = ArcCosine(Dot(a, b) / std::sqrt(aa * bb));
  const double second = ArcCosine(-Dot(a, c) / std::sqrt(aa * cc));
  const double third = std::max(kPi - first - second, 0.0);
  return {FacetNormal(t),
          {static_cast<float>(first), static_cast<float>(second), static_cast<float>(third)},
          triangle,
          t.smoothing};
}

void CornerFans::Add(const TriangleRecord& t, uint32_t triangle, uint32_t corner, uint32_t hash) {
  const uint32_t slot = SlotOf(t.vertices[corner], hash);
  if (++counts_[slot] > kMostAround) return;
  if (faces_.empty() || faces_.back().triangle != triangle) faces_.push_back(MakeFace(t, triangle));
  corners_.push_back({slot, static_cast<uint32_t>(faces_.size() - 1) << 2 | corner});
}

/// Solves one fan: faces and their corners, in the form of PlacedCorner. Eight corners at a time are added up
/// over all corners of the fan, in order.
void CornerFans::SolveFan(std::span<const uint32_t> fan, std::vector<CornerNormal>& normals) const {
  if (fan.size() < 2) return;  // the facet's normal
  alignas(32) float x[kMostAround + kLanes], y[kMostAround + kLanes], z[kMostAround + kLanes],
      angles[kMostAround + kLanes];
  alignas(32) int32_t smoothing[kMostAround + kLanes];
  const size_t last = (fan.size() - 1) / kLanes * kLanes;
  for (float* column : {x, y, z, angles}) std::fill_n(column + last, kLanes, 0.0f);
  std::fill_n(smoothing + last, kLanes, 0);
  for (size_t i = 0; i < fan.size(); ++i) {
    const uint32_t corner = fan[i];
    const Face& face = faces_[corner >> 2];
    x[i] = face.normal.x;
    y[i] = face.normal.y;
    z[i] = face.normal.z;
    angles[i] = face.angles[corner & 3];
    smoothing[i] = face.smoothing;
  }
  for (size_t i = 0; i < fan.size(); i += kLanes) {
    const Float8 nx = Load<Float8>(x + i), ny = Load<Float8>(y + i), nz = Load<Float8>(z + i);
    const Int8 group = Load<Int8>(smoothing + i), number = kLaneNumbers + static_cast<int32_t>(i);
    Float8 around = Load<Float8>(angles + i);
    Float8 sx = around * nx, sy = around * ny, sz = around * nz;
    for (size_t j = 0; j < fan.size(); ++j) {
      const Float8 cosine = nx * x[j] + ny * y[j] + nz * z[j];
      const Int8 turned = cosine < 0;
      const bool by_angle = smoothing[j] == kSmoothByAngle;
      const Int8 apart = by_angle ? ((turned ? -cosine : cosine) < smooth_cosine_) : (cosine < kTurnedCosine);
      const Int8 meets = (group == smoothing[j]) & (number != static_cast<int32_t>(j)) & ~apart;
      const Float8 plain = Float8{} + angles[j], weight = by_angle ? (turned ? -plain : plain) : plain;
      sx = meets ? sx + weight * x[j] : sx;
      sy = meets ? sy + weight * y[j] : sy;
      sz = meets ? sz + weight * z[j] : sz;
      around = meets ? around + plain : around;
    }
    const Float8 squares = sx * sx + sy * sy + sz * sz, along = sx * nx + sy * ny + sz * nz;
    for (size_t lane = 0; lane < std::min(kLanes, fan.size() - i); ++lane) {
      const float length = std::sqrt(squares[lane]);
      // Negated, so that sums that are not numbers are left out too.
      if (!(length > kLeastShare * around[lane] && along[lane] < kFlatCosine * length)) continue;
      const uint32_t corner = fan[i + lane];
      normals.push_back(
          {faces_[corner >> 2].triangle, corner & 3, PackNormal(glm::vec3(sx[lane], sy[lane], sz[lane]))});
    }
  }
}

std::vector<CornerNormal> CornerFans::Solve() const {
  std::vector<uint32_t> ends(positions_.size());
  uint32_t end = 0;
  for (size_t slot = 0; slot < ends.size(); ++slot) {
    ends[slot] = end;
    end += std::min(counts_[slot], kMostAround);
  }
  std::vector<uint32_t> by_slot(corners_.size());
  for (const PlacedCorner& c : corners_) by_slot[ends[c.slot]++] = c.face_corner;
  std::vector<CornerNormal> normals;
  for (size_t slot = 0; slot < ends.size(); ++slot)
    if (counts_[slot] <= kMostAround)
      SolveFan(std::span(by_slot).subspan(ends[slot] - counts_[slot], counts_[slot]), normals);
  return normals;
}

}  // namespace quarry
