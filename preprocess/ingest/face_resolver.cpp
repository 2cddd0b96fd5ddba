#include "preprocess/ingest/face_resolver.h"

#include <algorithm>
#include <utility>

namespace quarry {

Result<std::unique_ptr<FaceResolver>> FaceResolver::Open(const std::string& folder, TriangleSpill& triangles,
                                                         WorkTeam& team) {
  QUARRY_ASSIGN(VertexStreams vertices, VertexStreams::Open(folder));
  QUARRY_ASSIGN(WaitingFaces waiting, WaitingFaces::Open(folder));
  return std::unique_ptr<FaceResolver>(
      new FaceResolver(std::move(vertices), std::move(waiting), triangles, team));
}

Status FaceResolver::AddPolygon(Face face, std::span<const Corner> corners) {
  face.following = static_cast<uint32_t>(corners.size()) - 2;
  for (size_t i = 2; i < corners.size(); ++i, ++face.id) {
    face.corners[0] = corners[0];
    face.corners[1] = corners[i - 1];
    face.corners[2] = corners[i];
    --face.following;
    gathered_.push_back(face);
  }
  return gathered_.size() < kBatchFaces ? Status{} : StartBatch();
}

Status FaceResolver::StartBatch() {
  if (running_.valid()) QUARRY_TRY(running_.get());
  batch_.clear();
  std::swap(batch_, gathered_);
  running_ = std::async(std::launch::async, [this] { return ResolveBatch(); });
  return {};
}

Status FaceResolver::SettleNow() {
  if (running_.valid()) QUARRY_TRY(running_.get());
  batch_.clear();
  std::swap(batch_, gathered_);
  return ResolveBatch();
}

/// Faces are looked for in the pages as they are when the batch begins. Then pages are loaded for those that
/// were missed: which they are depends on no thread.
Status FaceResolver::ResolveBatch() {
  // How many pages may be loaded follows from the faces so far.
  const uint64_t loads = (resolved_ + batch_.size()) / kFacesPerLoad - resolved_ / kFacesPerLoad;
  loads_left_ = static_cast<uint32_t>(std::min<uint64_t>(loads_left_ + loads, kMostLoads));
  resolved_ += batch_.size();
  missed_.clear();
  slices_.resize(team_.threads());
  for (std::span<const Face> left = batch_; !left.empty();) {
    size_t slices = 0;
    while (slices < slices_.size() && !left.empty()) slices_[slices++].faces = CutSlice(left);
    team_.ForEach(slices, [&](size_t i) { ResolveSlice(slices_[i]); });
    for (const Slice& slice : std::span(slices_).first(slices)) {
      QUARRY_TRY(triangles_.Take(slice.resolved));
      missed_.insert(missed_.end(), slice.missed.begin(), slice.missed.end());
    }
  }
  for (const std::span<const Face> polygon : missed_) QUARRY_TRY(ResolveMissed(polygon));
  return {};
}

/// Takes whole polygons off the faces that are left.
std::span<const Face> FaceResolver::CutSlice(std::span<const Face>& left) {
  size_t end = 0;
  while (end < std::min(left.size(), kSliceFaces)) end += left[end].following + 1;
  const std::span<const Face> slice = left.first(end);
  left = left.subspan(end);
  return slice;
}

/// The triangles of a polygon are resolved together, or missed together: their vertices decide how the
/// polygon is split.
void FaceResolver::ResolveSlice(Slice& slice) {
  slice.resolved.Clear();
  slice.missed.clear();
  const bool bare = triangles_.attributes() < Attributes::kNormals;  // each record is filled whole
  for (std::span<const Face> left = slice.faces; !left.empty();) {
    const std::span<const Face> polygon = left.first(left.front().following + 1);
    left = left.subspan(polygon.size());
    if (polygon.size() > kSliceFaces) {  // all slices share the memory for these
      slice.missed.push_back(polygon);
      continue;
    }
    if (slice.fan.size() < polygon.size()) slice.fan.resize(polygon.size());
    const std::span<TriangleRecord> fan = std::span(slice.fan).first(polygon.size());
    if (!bare) std::ranges::fill(fan, TriangleRecord{});
    size_t found = 0;
    while (found < fan.size() && vertices_.Find(polygon[found], fan[found])) ++found;
    if (found == fan.size())
      triangles_.Check(fan, slice.resolved);
    else
      slice.missed.push_back(polygon);
  }
}

/// Resolves a polygon, or has it wait.
Status FaceResolver::ResolveMissed(std::span<const Face> polygon) {
  fan_.assign(polygon.size(), TriangleRecord{});
  bool resolved = true;
  for (size_t k = 0; k < polygon.size(); ++k) {
    QUARRY_ASSIGN(const bool found, Resolve(polygon[k], fan_[k]));
    resolved &= found;
  }
  if (resolved) return triangles_.AddPolygon(fan_);
  for (const Face& face : polygon) QUARRY_TRY(waiting_.Add(face));
  return {};
}

/// False: the face has to wait.
Result<bool> FaceResolver::Resolve(const Face& face, TriangleRecord& record) {
  if (vertices_.Find(face, record)) [[likely]]
    return true;
  if (loads_left_ == 0) return false;
  QUARRY_TRY(vertices_.Load(face, loads_left_));
  return vertices_.Find(face, record);
}

std::vector<SpillFile*> FaceResolver::Files() {
  std::vector<SpillFile*> files = vertices_.Files();
  for (SpillFile* file : waiting_.Files()) files.push_back(file);
  return files;
}

}  // namespace quarry
