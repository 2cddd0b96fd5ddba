#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/check.h"
#include "common/base/status.h"
#include "preprocess/ingest/emitter_list.h"
#include "preprocess/ingest/imported_scene.h"
#include "preprocess/ingest/part_sums.h"
#include "preprocess/ingest/triangle_batch.h"
#include "preprocess/spill/spill_writer.h"

namespace quarry {

/// Gathers resolved triangles of all model files in the file "FOLDER/triangles-N", where N stands for the
/// attributes. Triangles without area and triangles with coordinates that are not finite are dropped and
/// counted; their ids stay used.
/// Thread safety: Check() may run on several threads; Check(), Take() and AddPolygon() may run beside
/// NewIds() and input_triangles(). Nothing else.
class TriangleSpill {
 public:
  explicit TriangleSpill(std::string folder) : folder_(std::move(folder)) {}

  /// Creates the file unless it is open. Required before the first triangle.
  Status Open();

  /// The first of `count` consecutive ids. Errors: ids are 32 bits (4,294,967,294 triangles in all).
  Result<uint32_t> NewIds(uint64_t count, const std::string& file_name);
  uint64_t input_triangles() const { return out_.input_triangles; }

  Attributes attributes() const { return out_.attributes; }
  /// Makes records wide enough for `attributes`; records kept so far are copied to a new file.
  Status Widen(Attributes attributes) {
    if (out_.attributes >= attributes) [[likely]]
      return {};
    return WidenNow(attributes);
  }

  /// See ModelSink. Not beside Check().
  void SetAlphaLevels(uint32_t material, uint32_t first) { alpha_levels_[material] = first; }

  /// See EmitterList. Not beside Check().
  void NoteMaterial(uint32_t number, const Material& material) { emitters_.NoteMaterial(number, material); }

  /// Splits the fan of one polygon in place (see PolygonFan) and adds its triangles to `batch`.
  void Check(std::span<TriangleRecord> fan, TriangleBatch& batch) const;
  /// Keeps the triangles of the batch. Errors: disk full.
  Status Take(const TriangleBatch& batch);
  /// Checks and keeps the triangles of one polygon. Errors: disk full.
  Status AddPolygon(std::span<TriangleRecord> fan);
  /// Whether the triangles exceed the number that is split in memory.
  bool spills() const;

  /// Writes the file out and appends the state that Restore() needs to `out`.
  Status Save(ByteWriter& out);
  /// With `routed`, the triangles have been routed to regions since: the file may be gone. Errors: the file
  /// has fewer triangles than it had.
  Status Restore(ByteReader& in, bool routed);
  std::string Path() const;

  /// Requires: Open() was called.
  Status FinishWriting() {
    QUARRY_CHECK(out_.triangles);
    return out_.triangles->FinishWriting();
  }
  const ImportedTriangles& result() const { return out_; }
  /// Of all triangles, dropped triangles too.
  PartSums TakeParts() { return std::move(parts_); }
  std::vector<Emitter> TakeEmitters() { return emitters_.Take(); }
  ImportedTriangles Take() {
    WeighUp();
    return std::move(out_);
  }

 private:
  /// Sets the evidence of the sample, if there is one.
  void WeighUp();
  Result<SpillFile> OpenFile(uint64_t count);
  Status WidenNow(Attributes attributes);
  void CheckTriangle(TriangleRecord& record, TriangleBatch& batch) const;
  void TakeAlpha(TriangleRecord& record) const;

  std::string folder_;
  ImportedTriangles out_;
  TriangleBatch one_;  ///< of AddPolygon()
  PartSums parts_;
  EmitterList emitters_;
  std::map<uint32_t, uint32_t> alpha_levels_;  ///< by material: the first of its levels
  SpillWriter writer_;  ///< of the file in out_; declared last, so that it ends before the file
};

}  // namespace quarry
