#include "preprocess/ingest/waiting_faces.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

namespace quarry {

Result<WaitingFaces> WaitingFaces::Open(const std::string& folder) {
  QUARRY_ASSIGN(SpillFile faces, SpillFile::Open(folder + "/import-waiting", sizeof(Face), 0));
  return WaitingFaces(folder, std::move(faces));
}

std::string WaitingFaces::PartialPath(int number) const {
  return fmt::format("{}/import-partial-{}", folder_, number);
}

std::vector<SpillFile*> WaitingFaces::Files() {
  if (partial_) return {&faces_, &*partial_};
  return {&faces_};
}

Status WaitingFaces::Resolve(VertexStreams& vertices, uint64_t memory, const std::string& file_name,
                             TriangleSpill& triangles) {
  QUARRY_TRY(faces_.FinishWriting());
  if (faces_.count() == 0) return {};
  QUARRY_TRY(vertices.FinishWriting());
  const uint64_t window = VertexWindow::CountFor(std::max<uint64_t>(memory / 4, 1 << 20));
  const uint64_t longest = std::max({vertices.positions(), vertices.normals(), vertices.uvs()});
  for (;;) {
    QUARRY_TRY(ResolveWindow(vertices, window, resolved_ + window >= longest, file_name, triangles));
    resolved_ += window;
    if (resolved_ >= longest) return {};
    std::error_code none;
    std::filesystem::remove(PartialPath(partial_number_ ^ 1), none);  // the pass before it
  }
}

/// One pass: fills in the elements of the next window. Records go to the next partial file, or, in the last
/// pass, to the triangles.
Status WaitingFaces::ResolveWindow(const VertexStreams& vertices, uint64_t window_count, bool last,
                                   const std::string& file_name, TriangleSpill& triangles) {
  VertexWindow window;
  QUARRY_TRY(window.Load(vertices, resolved_, window_count));
  std::optional<SpillFile> next;
  if (!last) {
    partial_number_ ^= 1;
    QUARRY_ASSIGN(next,
                  SpillFile::Open(PartialPath(partial_number_), RecordBytes(triangles.attributes()), 0));
  }
  std::vector<TriangleRecord> fan;
  SpillReader faces(faces_);
  std::optional<SpillReader> records;
  if (partial_) records.emplace(*partial_);
  while (const std::byte* bytes = faces.Next()) {
    Face face;
    std::memcpy(&face, bytes, sizeof face);
    TriangleRecord record;
    if (records) {
      const std::byte* kept = records->Next();
      if (!kept) return records->status();
      std::memcpy(&record, kept, partial_->element_bytes());
    }
    record.id = face.id;
    record.material = face.material;
    record.smoothing = face.smoothing;
    record.part = face.part;
    if (!vertices.Has(face))
      return Fail(
          fmt::format("{}: triangle {} refers to a vertex that the file does not have ({} vertices, {} "
                      "normals, {} texture coordinates)",
                      file_name, face.id, vertices.positions(), vertices.normals(), vertices.uvs()));
    window.FillIn(face, record);
    if (!last) {
      QUARRY_TRY(next->Append(&record));
      continue;
    }
    fan.push_back(record);
    if (face.following > 0) continue;
    QUARRY_TRY(triangles.AddPolygon(fan));
    fan.clear();
  }
  QUARRY_TRY(faces.status());
  if (next) {
    QUARRY_TRY(next->FinishWriting());
    partial_ = std::move(next);
  }
  return {};
}

}  // namespace quarry
