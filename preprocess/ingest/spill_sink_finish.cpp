// The end of an import: what is told of it, and the scene.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "preprocess/ingest/spill_sink.h"

namespace quarry {
namespace {

/// The step from one float to the next at the triangle's farthest coordinate, and its longest side along an
/// axis.
std::pair<float, float> StepAndSide(const KdTriangle& triangle) {
  float reach = 0, side = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto [least, most] =
        std::minmax({triangle.vertices[0][axis], triangle.vertices[1][axis], triangle.vertices[2][axis]});
    reach = std::max({reach, std::fabs(least), std::fabs(most)});
    side = std::max(side, most - least);
  }
  return {std::nextafter(reach, kInfinity) - reach, side};
}

}  // namespace

/// Floats hold a position to a share of its distance from the origin. Whether that is little depends on what
/// lies there, in metres or millimetres: the triangles.
void SpillSink::WarnOfLoss() {
  constexpr float kStepsOfSide = 32;  // to a thirtieth of a triangle's side: its shape is seen to suffer
  constexpr size_t kOneOf = 100;
  size_t coarse = 0;
  float largest = 0;
  for (const KdTriangle& triangle : scene_.sample.triangles()) {
    const auto [step, side] = StepAndSide(triangle);
    if (side >= kStepsOfSide * step) continue;
    ++coarse;
    largest = std::max(largest, step);
  }
  if (coarse * kOneOf < std::max<size_t>(scene_.sample.triangles().size(), 1) || largest_loss_ < largest / 4)
    return;
  Warn(
      fmt::format("{}: has small triangles far from the origin chosen for it: positions there are kept to "
                  "{:.2g} units; smaller "
                  "details are lost",
                  file_name_, largest));
}

Result<ImportedScene> SpillSink::Finish() {
  QUARRY_TRY(scene_.triangles->FinishWriting());
  if (scene_.materials.empty()) DefaultMaterial();
  if (scene_.materials.size() > 65536) return Fail(fmt::format("{}: more than 65536 materials", file_name_));
  if (scene_.triangles->count() == 0)
    return Fail(
        fmt::format("{}: no triangle is left: {} degenerate, {} with coordinates that are not finite{}",
                    file_name_, scene_.dropped_degenerate, scene_.dropped_not_finite,
                    largest_loss_ < 1e-3 ? ""
                                         : fmt::format("; positions are kept to {:.2g} so far from "
                                                       "the origin",
                                                       2 * largest_loss_)));
  WarnOfLoss();
  QUARRY_ASSIGN(scene_.images, images_.Finish());
  return std::move(scene_);
}

}  // namespace quarry
