#pragma once

#include <cstdint>
#include <future>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/ingest/triangle_spill.h"
#include "preprocess/ingest/vertex_streams.h"
#include "preprocess/ingest/waiting_faces.h"

namespace quarry {

/// Turns the polygons of one model file into triangles with their vertices filled in. Faces are resolved in
/// batches by a second thread, from pages in memory or worth loading; the others wait for the file's end.
/// Whether a face waits depends on the file alone, so the order of triangles does too.
/// While a batch runs, its thread alone touches the vertices, the waiting faces and the triangles: Settle()
/// comes before any other use of them. Thread safety: none otherwise.
class FaceResolver {
 public:
  /// Creates or empties the file's streams in `folder`.
  static Result<std::unique_ptr<FaceResolver>> Open(const std::string& folder, TriangleSpill& triangles);

  /// Adds a polygon as a fan of triangles with ids face.id, face.id + 1, ... Material, part and colour are
  /// `face`'s. Requires: 3 corners or more. Errors: disk full, also of an earlier batch.
  Status AddPolygon(Face face, std::span<const Corner> corners);
  /// Resolves all faces added so far, or has them wait. Small batches run on this thread: many files change
  /// between vertices and faces every few lines. Errors: disk full.
  Status Settle() {
    if (!running_.valid() && gathered_.empty()) [[likely]]
      return {};
    return SettleNow();
  }
  /// Requires: Settle().
  VertexStreams& vertices() { return vertices_; }
  WaitingFaces& waiting() { return waiting_; }

  /// The files of the streams and the waiting faces, which may be moved from when the resolver has done its
  /// work. Requires: Settle().
  std::vector<SpillFile*> Files();

 private:
  // A page may be loaded for so many faces added; loads not used are saved up to a bound.
  static constexpr uint32_t kFacesPerLoad = 64, kMostLoads = 4096;

  FaceResolver(VertexStreams vertices, WaitingFaces waiting, TriangleSpill& triangles)
      : vertices_(std::move(vertices)), waiting_(std::move(waiting)), triangles_(triangles) {}
  Status SettleNow();
  Status StartBatch();
  Status ResolveBatch();
  Result<bool> Resolve(const Face& face, TriangleRecord& record);

  VertexStreams vertices_;
  WaitingFaces waiting_;
  TriangleSpill& triangles_;
  uint32_t loads_left_ = kMostLoads, faces_to_next_load_ = kFacesPerLoad;
  std::vector<Face> gathered_, batch_;
  std::vector<TriangleRecord> fan_;  ///< of the polygon that is being resolved
  std::future<Status> running_;      ///< last: its destructor waits for the thread, which uses the rest
};

}  // namespace quarry
