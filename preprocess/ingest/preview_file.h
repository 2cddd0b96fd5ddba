#pragma once

#include <chrono>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <string>

#include "common/scene/material.h"
#include "preprocess/ingest/imported_scene.h"

namespace quarry {

/// A preview of a model that is being read: its sample as discs, in the file beside
/// QUARRY_PROGRESS_FILE with the suffix .discs, for the page of `quarry view`. A sampled triangle becomes a
/// disc of the area that it stands for, unless that is wide: then of its own. The file is replaced whole, at
/// most every quarter of a second, and so seldom that writing takes a twentieth of the time. Its layout:
/// master/display/PROTOCOL.md. Thread safety: none.
class PreviewFile {
 public:
  /// The file that the environment asks for; nothing: none. `up_axis`: 1 y, 2 z, 0 guessed, with `habit` as
  /// evidence beside the triangles'.
  static std::optional<PreviewFile> Wanted(uint32_t up_axis, double habit);

  /// Whether it is time to write.
  bool due() const { return Clock::now() >= next_; }
  /// Writes the discs of the triangles so far. `part`: of the file that is read, in bytes. `offset`: from the
  /// triangles' coordinates to the scene's. An error is ignored: the file is soon replaced.
  void Write(const ImportedTriangles& triangles, std::span<const Material> materials, double part,
             const glm::dvec3& offset);

 private:
  using Clock = std::chrono::steady_clock;
  PreviewFile(std::string path, uint32_t up_axis, double habit)
      : path_(std::move(path)), up_axis_(up_axis), habit_(habit) {}
  uint32_t UpAxisOf(const TriangleSample& sample) const;

  std::string path_;
  uint32_t up_axis_;
  double habit_;
  Clock::time_point next_;
};

}  // namespace quarry
