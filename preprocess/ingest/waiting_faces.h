#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/ingest/triangle_spill.h"
#include "preprocess/ingest/vertex_streams.h"
#include "preprocess/spill/spill_file.h"

namespace quarry {

/// Faces of one model file whose vertices lie far apart or come later. They wait on disk and are resolved
/// when the file ends: one sequential pass over all of them for each window of the vertices that fits in
/// memory, never by random access. Half-filled records travel from pass to pass through two files
/// "FOLDER/import-partial-N". Thread safety: none.
class WaitingFaces {
 public:
  /// Creates or empties the files.
  static Result<WaitingFaces> Open(const std::string& folder);

  /// Errors: disk full.
  Status Add(const Face& face) { return faces_.Append(&face); }
  /// Resolves all faces into `triangles`. Units: memory in bytes; a window takes a quarter.
  /// Errors: a face names a vertex that the file does not have; disk full.
  Status Resolve(VertexStreams& vertices, uint64_t memory, const std::string& file_name,
                 TriangleSpill& triangles);

  std::vector<SpillFile*> Files();

 private:
  WaitingFaces(std::string folder, SpillFile faces) : folder_(std::move(folder)), faces_(std::move(faces)) {}
  std::string PartialPath(int number) const;
  Status ResolveWindow(const VertexStreams& vertices, uint64_t window, bool last,
                       const std::string& file_name, TriangleSpill& triangles);

  std::string folder_;
  SpillFile faces_;
  uint64_t resolved_ = 0;             ///< elements of each stream in the windows so far
  std::optional<SpillFile> partial_;  ///< the last pass's records
  uint8_t partial_number_ = 0;
};

}  // namespace quarry
