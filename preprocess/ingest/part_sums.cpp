#include "preprocess/ingest/part_sums.h"

#include <algorithm>
#include <cstring>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

namespace quarry {
namespace {

/// Mixes two numbers by a product of 128 bits, one multiplication. Source: the function mum of wyhash (Wang
/// Yi); its constants.
uint64_t Mix(uint64_t a, uint64_t b) {
  constexpr uint64_t kFirst = 0xA0761D6478BD642F, kSecond = 0xE7037ED1A0B428DB;
  const auto product = static_cast<unsigned __int128>(a ^ kFirst) * (b ^ kSecond);
  return static_cast<uint64_t>(product) ^ static_cast<uint64_t>(product >> 64);
}

/// A hash of a position by its bits; -0 is 0. Inlined: an import calls it three times a triangle.
[[gnu::always_inline]] inline uint64_t HashOf(const glm::vec3& position) {
  const glm::vec3 p = position + glm::vec3(0.0f);
  uint64_t xy;
  uint32_t z;
  std::memcpy(&xy, &p.x, sizeof xy);
  std::memcpy(&z, &p.z, sizeof z);
  return Mix(xy, z);
}

/// The hash of the edge from a to b, the negative of that from b to a.
uint64_t EdgeHash(uint64_t a, uint64_t b) {
  if (a == b) return 0;
  return a < b ? Mix(a, b) : -Mix(b, a);
}

}  // namespace

void PartRun::Add(const TriangleRecord& triangle, TriangleFault fault) {
  const glm::vec3(&v)[3] = triangle.vertices;
  const uint64_t a = HashOf(v[0]), b = HashOf(v[1]), c = HashOf(v[2]);
  sum.edges += EdgeHash(a, b) + EdgeHash(b, c) + EdgeHash(c, a);
  ++sum.triangles;
  if (fault != TriangleFault::kNone) return;
  if (sum.lower.x > sum.upper.x) sum.origin = v[0];
  sum.lower = glm::min(sum.lower, glm::min(v[0], glm::min(v[1], v[2])));
  sum.upper = glm::max(sum.upper, glm::max(v[0], glm::max(v[1], v[2])));
  const glm::dvec3 from(v[0]), normal = glm::cross(glm::dvec3(v[1]) - from, glm::dvec3(v[2]) - from);
  sum.volume += glm::dot(from - glm::dvec3(sum.origin), normal);
  across += normal;
}

void PartSums::Add(const PartRun& run) {
  if (run.part >= sums_.size()) sums_.resize(size_t{run.part} + 1);
  PartSum& sum = sums_[run.part];
  sum.edges += run.sum.edges;
  sum.triangles += run.sum.triangles;
  if (run.sum.lower.x > run.sum.upper.x) return;  // no triangle has an area
  if (sum.lower.x > sum.upper.x) sum.origin = run.sum.origin;
  sum.lower = glm::min(sum.lower, run.sum.lower);
  sum.upper = glm::max(sum.upper, run.sum.upper);
  // Seen from another origin, each triangle's share changes by the same distance along its normal.
  const glm::dvec3 moved = glm::dvec3(run.sum.origin) - glm::dvec3(sum.origin);
  sum.volume += run.sum.volume + glm::dot(moved, run.across);
}

void PartSums::GiveTo(std::vector<ScenePart>& parts) const {
  for (size_t i = 0; i < std::min(parts.size(), sums_.size()); ++i) {
    const PartSum& sum = sums_[i];
    ScenePart& part = parts[i];
    part.triangles = sum.triangles;
    part.lower = sum.lower;
    part.upper = sum.upper;
    if (sum.triangles == 0 || sum.edges != 0) continue;
    part.flags = ScenePart::kClosed | (sum.volume < 0 ? ScenePart::kInsideOut : 0);
  }
}

void PartSums::Save(ByteWriter& out) const {
  out.Put(uint64_t{sums_.size()});
  out.PutArray(sums_);
}

void PartSums::Restore(ByteReader& in) { sums_ = in.GetArray<PartSum>(in.Get<uint64_t>()); }

}  // namespace quarry
