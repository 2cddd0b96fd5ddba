#include "preprocess/ingest/spill_sink.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/file.h"

namespace quarry {
namespace {

constexpr uint32_t kFacesPerLook = 4096;  // between looks at the clock

std::string StatePath(const std::string& folder) { return folder + "/import-state"; }

/// The step from one float to the next at the triangle's farthest coordinate, and its longest side along an
/// axis, in scene units.
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

/// Warns if floats are too coarse for a sample of the triangles. Whether a loss matters depends on the
/// triangles' size, in metres or millimetres.
void WarnOfLoss(const std::vector<KdTriangle>& sample, const SceneCoordinates& coordinates,
                SceneTables& tables) {
  // A side of 32 steps is kept to a thirtieth: the triangle's shape visibly suffers.
  constexpr float kStepsOfSide = 32;
  constexpr size_t kOneOf = 100;
  size_t coarse = 0;
  float largest = 0;
  for (const KdTriangle& triangle : sample) {
    const auto [step, side] = StepAndSide(triangle);
    if (side >= kStepsOfSide * step) continue;
    ++coarse;
    largest = std::max(largest, step);
  }
  if (coarse * kOneOf < std::max<size_t>(sample.size(), 1) || coordinates.largest_loss() < largest / 4)
    return;
  tables.Warn(
      fmt::format("{}: has small triangles far from its chosen origin: positions there are kept to "
                  "{:.2g} units; smaller "
                  "details are lost",
                  tables.file_name(), largest));
}

}  // namespace

SpillSink::SpillSink(std::string folder, uint64_t memory, double scale,
                     std::function<void(const std::string&)> warn, bool textures,
                     std::optional<PreviewFile> preview, unsigned threads)
    : folder_(std::move(folder)),
      memory_(memory),
      textures_(textures),
      coordinates_(scale),
      tables_(std::move(warn)),
      images_(folder_ + "/images"),
      team_(threads < 2 ? 0 : threads - 2),
      triangles_(folder_),
      preview_(std::move(preview)) {}

Status SpillSink::BeginFile(std::string_view name) {
  tables_.BeginFile(name);
  face_color_ = kWhite;
  smoothing_ = kSmoothByAngle;
  ++file_number_;
  QUARRY_ASSIGN(faces_, FaceResolver::Open(folder_, triangles_, team_));
  return triangles_.Open();
}

Status SpillSink::AddPosition(const glm::dvec3& position, const Rgba8& color) {
  QUARRY_TRY(faces_->Settle());
  const uint32_t packed = Packed(color);
  if (packed != kWhite) QUARRY_TRY(triangles_.Widen(Attributes::kColors));
  return faces_->vertices().AddPosition(coordinates_.Store(position), packed);
}

Status SpillSink::AddNormal(const glm::vec3& normal) {
  QUARRY_TRY(faces_->Settle());
  QUARRY_TRY(triangles_.Widen(Attributes::kNormals));
  return faces_->vertices().AddNormal(glm::vec3(coordinates_.Direction(glm::dvec3(normal))));
}

Status SpillSink::AddUv(const glm::vec2& uv) {
  QUARRY_TRY(faces_->Settle());
  QUARRY_TRY(triangles_.Widen(Attributes::kUvs));
  return faces_->vertices().AddUv(uv);
}

Status SpillSink::SetFaceColor(const Rgba8& color) {
  face_color_ = Packed(color);
  if (face_color_ == kWhite || triangles_.attributes() >= Attributes::kColors) [[likely]]
    return {};
  QUARRY_TRY(faces_->Settle());
  return triangles_.Widen(Attributes::kColors);
}

Status SpillSink::NoteShining() {
  QUARRY_TRY(faces_->Settle());
  for (const auto& [number, material] : shining_) triangles_.NoteMaterial(number, material);
  shining_.clear();
  return {};
}

Status SpillSink::AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) {
  if (corners.size() < 3) return {};
  if (!shining_.empty()) QUARRY_TRY(NoteShining());
  if (preview_ && ++unshown_ % kFacesPerLook == 0 && preview_->due()) {
    QUARRY_TRY(faces_->Pause());  // the sample belongs to the thread that resolves
    preview_->Write(triangles_.result(), tables_.materials(), read_part_, coordinates_.offset());
  }
  Face face;
  face.part = part == kNoIndex ? tables_.FilePart() : part;
  // Scenes with more materials than fit are refused by Finish().
  face.material = static_cast<uint16_t>(
      std::min(material == kNoIndex ? tables_.DefaultMaterial() : material, SceneTables::kMostMaterials - 1));
  face.smoothing = smoothing_;
  face.color = face_color_;
  QUARRY_ASSIGN(face.id, triangles_.NewIds(corners.size() - 2, tables_.file_name()));
  return faces_->AddPolygon(face, corners);
}

Status SpillSink::EndFile() {
  QUARRY_TRY(faces_->Settle());
  QUARRY_TRY(faces_->waiting().Resolve(faces_->vertices(), memory_, tables_.file_name(), triangles_));
  for (SpillFile* file : faces_->Files()) file->Remove();
  faces_.reset();
  return {};
}

Result<Bytes> SpillSink::Save() {
  ByteWriter out;
  coordinates_.Save(out);
  tables_.Save(out);
  QUARRY_TRY(images_.Save(out));
  QUARRY_TRY(triangles_.Save(out));
  const Bytes state = out.Take();
  QUARRY_TRY(WriteFile(StatePath(folder_), state));
  ByteWriter reference;
  reference.Put(uint64_t{state.size()});
  reference.Put(Checksum(state));
  return reference.Take();
}

Status SpillSink::Restore(std::span<const std::byte> saved, bool routed) {
  ByteReader reference(saved);
  const auto size = reference.Get<uint64_t>(), checksum = reference.Get<uint64_t>();
  const auto file = InputFile::Open(StatePath(folder_));
  Bytes state(file && reference.done() && file->size() == size ? size : 0);
  if (state.empty() || !file->ReadAt(0, state) || Checksum(state) != checksum)
    return CannotResume(fmt::format("{}: has changed since the import saved it", StatePath(folder_)));
  ByteReader in(state);
  coordinates_.Restore(in);
  tables_.Restore(in);
  QUARRY_TRY(images_.Restore(in));
  QUARRY_TRY(triangles_.Restore(in, routed));
  if (!in.done())
    return CannotResume(fmt::format("{}: the saved part of the import cannot be read", folder_));
  return {};
}

Result<ImportedScene> SpillSink::Finish() {
  const std::string& file_name = tables_.file_name();
  QUARRY_TRY(triangles_.FinishWriting());
  QUARRY_TRY(tables_.Finish());
  const ImportedTriangles& kept = triangles_.result();
  if (kept.triangles->count() == 0)
    return Fail(fmt::format(
        "{}: no triangle is left: {} degenerate, {} with coordinates that are not finite{}", file_name,
        kept.dropped_degenerate, kept.dropped_not_finite,
        coordinates_.largest_loss() < 1e-3 ? ""
                                           : fmt::format("; positions are kept to {:.2g} so far from "
                                                         "the origin",
                                                         2 * coordinates_.largest_loss())));
  if (preview_) preview_->Write(kept, tables_.materials(), 1, coordinates_.offset());
  WarnOfLoss(kept.sample.triangles(), coordinates_, tables_);
  ImportedScene scene{triangles_.Take(), tables_.Take(), coordinates_.offset(), {}};
  triangles_.TakeParts().GiveTo(scene.parts.facts);
  scene.emitters = triangles_.TakeEmitters();
  QUARRY_ASSIGN(scene.images, images_.Finish());
  return scene;
}

}  // namespace quarry
