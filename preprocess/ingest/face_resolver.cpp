#include "preprocess/ingest/face_resolver.h"

#include <algorithm>
#include <utility>

namespace quarry {

Result<std::unique_ptr<FaceResolver>> FaceResolver::Open(const std::string& folder,
                                                         TriangleSpill& triangles) {
  QUARRY_ASSIGN(VertexStreams vertices, VertexStreams::Open(folder));
  QUARRY_ASSIGN(WaitingFaces waiting, WaitingFaces::Open(folder));
  return std::unique_ptr<FaceResolver>(new FaceResolver(std::move(vertices), std::move(waiting), triangles));
}

Status FaceResolver::AddPolygon(Face face, std::span<const Corner> corners) {
  constexpr size_t kBatchFaces = 8192;
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

/// The triangles of a polygon are resolved together, or wait together: their vertices decide how the polygon
/// is split.
Status FaceResolver::ResolveBatch() {
  const bool bare = triangles_.attributes() < Attributes::kNormals;  // each record is filled whole
  for (size_t i = 0, end; i < batch_.size(); i = end) {
    end = i + batch_[i].following + 1;
    if (fan_.size() < end - i) fan_.resize(end - i);
    const std::span<TriangleRecord> fan = std::span(fan_).first(end - i);
    if (!bare) std::ranges::fill(fan, TriangleRecord{});
    bool resolved = true;
    for (size_t k = i; k < end; ++k) {
      QUARRY_ASSIGN(const bool found, Resolve(batch_[k], fan[k - i]));
      resolved &= found;
    }
    if (resolved) QUARRY_TRY(triangles_.AddPolygon(fan));
    for (size_t k = i; k < end && !resolved; ++k) QUARRY_TRY(waiting_.Add(batch_[k]));
  }
  return {};
}

/// False: the face has to wait.
Result<bool> FaceResolver::Resolve(const Face& face, TriangleRecord& record) {
  if (--faces_to_next_load_ == 0) {
    faces_to_next_load_ = kFacesPerLoad;
    loads_left_ = std::min(loads_left_ + 1, kMostLoads);
  }
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
