#include "preprocess/ingest/preview_file.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <system_error>
#include <vector>

#include "common/base/bytes.h"
#include "preprocess/ingest/up_evidence.h"

namespace quarry {
namespace {

constexpr uint32_t kMagic = 0x31435351;  // "QSC1"
constexpr double kPi = 3.14159265358979323846;

/// A linear component as a byte of sRGB, near enough for a preview.
uint8_t Encoded(float linear) {
  return static_cast<uint8_t>(std::lround(255 * std::pow(std::clamp(linear, 0.0f, 1.0f), 1 / 2.2f)));
}

/// The colour of a sampled triangle, a byte each, red lowest.
uint32_t ColorOf(const SampledLook& look, std::span<const Material> materials) {
  const glm::vec3 base =
      look.material < materials.size() ? materials[look.material].base_color : Material().base_color;
  uint32_t packed = 0;
  for (int i = 0; i < 3; ++i) {
    const float vertex = std::pow(static_cast<float>(look.color >> (8 * i) & 255) / 255, 2.2f);
    packed |= uint32_t{Encoded(base[i] * vertex)} << (8 * i);
  }
  return packed;
}

/// A unit vector, a signed byte each.
uint32_t Packed(const glm::dvec3& normal) {
  uint32_t packed = 0;
  for (int i = 0; i < 3; ++i)
    packed |= (static_cast<uint32_t>(std::lround(127 * normal[i])) & 255u) << (8 * i);
  return packed;
}

}  // namespace

std::optional<PreviewFile> PreviewFile::Wanted(uint32_t up_axis, double habit) {
  const char* progress = std::getenv("QUARRY_PROGRESS_FILE");
  if (!progress) return {};
  return PreviewFile(std::string(progress) + ".discs", up_axis, habit);
}

uint32_t PreviewFile::UpAxisOf(const TriangleSample& sample) const {
  if (up_axis_ != 0) return up_axis_;
  constexpr size_t kMost = 4096;
  std::vector<KdTriangle> some;
  const std::vector<KdTriangle>& all = sample.triangles();
  for (size_t i = 0; i < all.size(); i += all.size() / kMost + 1) some.push_back(all[i]);
  return UpEvidence(some) + habit_ > 0 ? 1 : 2;
}

void PreviewFile::Write(const ImportedTriangles& imported, std::span<const Material> materials, double part,
                        const glm::dvec3& offset) {
  constexpr auto kLeastPause = std::chrono::milliseconds(250);
  const TriangleSample& sample = imported.sample;
  const std::vector<KdTriangle>& triangles = sample.triangles();
  if (triangles.empty()) return;
  const auto begun = Clock::now();
  ByteWriter out;
  out.Put(kMagic);
  out.Put(static_cast<uint32_t>(triangles.size()));
  out.Put(imported.input_triangles);
  out.Put(static_cast<float>(part));
  out.Put(UpAxisOf(sample));
  out.PutVec3(imported.bounds.lower);
  out.PutVec3(imported.bounds.upper);
  out.PutVec3(offset);
  struct Disc {
    glm::vec3 centre;
    float radius;
    uint32_t normal, color;
  };
  std::vector<Disc> discs;
  discs.reserve(triangles.size());
  constexpr double kWidest = 1.0 / 150;  // of the model's diagonal
  const double widest =
      kWidest * glm::length(glm::dvec3(imported.bounds.upper) - glm::dvec3(imported.bounds.lower));
  for (size_t i = 0; i < triangles.size(); ++i) {
    const glm::vec3(&v)[3] = triangles[i].vertices;
    const glm::dvec3 across =
        glm::cross(glm::dvec3(v[1]) - glm::dvec3(v[0]), glm::dvec3(v[2]) - glm::dvec3(v[0]));
    const double length = glm::length(across);
    // A large triangle stands for itself: few are like it, and its disc would hide the rest.
    const double own = std::sqrt(length / 2 / kPi),
                 wanted = own * std::sqrt(static_cast<double>(sample.weight()));
    const double radius = std::min(wanted, std::max(own, widest));
    discs.push_back({(v[0] + v[1] + v[2]) / 3.0f, static_cast<float>(radius), Packed(across / length),
                     ColorOf(sample.looks()[i], materials)});
  }
  out.PutArray(discs);
  // Not durable, unlike other files: it is worth nothing after a loss of power.
  const std::string temporary = path_ + ".new";
  std::ofstream file(temporary, std::ios::binary);
  file.write(reinterpret_cast<const char*>(out.bytes().data()),
             static_cast<std::streamsize>(out.bytes().size()));
  file.close();
  std::error_code failed;
  if (file) std::filesystem::rename(temporary, path_, failed);
  const auto now = Clock::now();
  next_ = now + std::max<Clock::duration>(kLeastPause, 19 * (now - begun));
}

}  // namespace quarry
