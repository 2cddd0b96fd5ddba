#pragma once

#include <cstdint>
#include <future>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/work_team.h"
#include "preprocess/ingest/triangle_spill.h"
#include "preprocess/ingest/vertex_streams.h"
#include "preprocess/ingest/waiting_faces.h"

namespace quarry {

/// Turns the polygons of one model file into triangles with their vertices filled in. Faces are resolved in
/// batches beside the importer: slices of a batch by the threads of the team, from pages in memory; then, in
/// order, the faces that need a page which is worth loading. The others wait for the file's end.
/// Whether a face waits depends on the file and the calls of Settle() alone, so the order of triangles does
/// too.
/// While a batch runs, it alone touches the vertices, the waiting faces and the triangles: Settle() comes
/// before any other use of them. Thread safety: none otherwise.
class FaceResolver {
 public:
  /// Creates or empties the file's streams in `folder`.
  static Result<std::unique_ptr<FaceResolver>> Open(const std::string& folder, TriangleSpill& triangles,
                                                    WorkTeam& team);

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
  /// Waits for the batch that runs, and leaves the faces that have not begun: where batches end decides which
  /// faces wait. The triangles may be looked at afterwards. Errors: disk full.
  Status Pause() { return running_.valid() ? running_.get() : Status{}; }
  /// Requires: Settle().
  VertexStreams& vertices() { return vertices_; }
  WaitingFaces& waiting() { return waiting_; }

  /// The files of the streams and the waiting faces, which may be moved from when the resolver has done its
  /// work. Requires: Settle().
  std::vector<SpillFile*> Files();

 private:
  static constexpr size_t kBatchFaces = 8192, kSliceFaces = 512;
  // A page may be loaded for so many faces added; loads not used are saved up to a bound.
  static constexpr uint32_t kFacesPerLoad = 64, kMostLoads = 4096;

  /// Consecutive faces of a batch, as far as they have been resolved.
  struct Slice {
    std::span<const Face> faces;
    TriangleBatch resolved;
    std::vector<TriangleRecord> fan;            ///< of the polygon that is being resolved
    std::vector<std::span<const Face>> missed;  ///< polygons that need a page, or much memory
  };

  FaceResolver(VertexStreams vertices, WaitingFaces waiting, TriangleSpill& triangles, WorkTeam& team)
      : vertices_(std::move(vertices)), waiting_(std::move(waiting)), triangles_(triangles), team_(team) {}
  Status SettleNow();
  Status StartBatch();
  Status ResolveBatch();
  static std::span<const Face> CutSlice(std::span<const Face>& left);
  void ResolveSlice(Slice& slice);
  Status ResolveMissed(std::span<const Face> polygon);
  Result<bool> Resolve(const Face& face, TriangleRecord& record);

  VertexStreams vertices_;
  WaitingFaces waiting_;
  TriangleSpill& triangles_;
  WorkTeam& team_;
  uint32_t loads_left_ = kMostLoads;
  uint64_t resolved_ = 0;  ///< faces
  std::vector<Face> gathered_, batch_;
  std::vector<Slice> slices_;                  ///< one a thread
  std::vector<std::span<const Face>> missed_;  ///< of the batch
  std::vector<TriangleRecord> fan_;            ///< of a missed polygon
  std::future<Status> running_;  ///< last: its destructor waits for the thread, which uses the rest
};

}  // namespace quarry
