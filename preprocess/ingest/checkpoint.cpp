// How an import leaves off and goes on: what a SpillSink saves, and when.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "common/base/file.h"
#include "preprocess/ingest/spill_sink.h"
#include "preprocess/spill/saved_tables.h"

namespace quarry {

void SpillSink::NoteEvery(double seconds, std::function<Status()> note) {
  note_seconds_ = seconds;
  note_ = std::move(note);
}

bool SpillSink::CheckpointDue() {
  constexpr uint64_t kToLookAgain = 4096;
  const uint64_t given = positions_->count() + scene_.input_triangles;
  if (given - asked_at_ < kToLookAgain || !note_ || reads_once_) return false;
  asked_at_ = given;
  const std::chrono::duration<double> since = std::chrono::steady_clock::now() - noted_at_;
  return since.count() >= note_seconds_;
}

Status SpillSink::Checkpoint(const Bytes& state) {
  importer_state_ = state;
  return Note();
}

Status SpillSink::Note() {
  QUARRY_TRY(note_());
  file_noted_ = true;
  return {};
}

std::string SpillSink::StatePath() const { return FilePath(state_number_ ? "state-1" : "state-0"); }

Result<Bytes> SpillSink::Save() {
  QUARRY_TRY(Settle());
  QUARRY_TRY(scene_.triangles->Sync());
  ByteWriter out;
  out.Put(static_cast<uint8_t>(scene_.attributes));
  out.Put<uint8_t>(has_offset_);
  out.PutVec3(scene_.offset);
  out.Put(largest_loss_);
  out.PutVec3(scene_.bounds.lower);
  out.PutVec3(scene_.bounds.upper);
  for (const uint64_t n : {scene_.triangles->count(), scene_.input_triangles, scene_.dropped_degenerate,
                           scene_.dropped_not_finite})
    out.Put(n);
  out.Put(default_material_);
  PutMaterials(scene_.materials, out);
  PutTexts(scene_.parts, out);
  PutTexts(scene_.warnings, out);
  PutViews(scene_.views, out);
  QUARRY_TRY(images_.Save(out));
  out.Put<uint8_t>(in_file());
  if (in_file()) QUARRY_TRY(SaveFile(out));
  scene_.sample.Save(out);
  state_number_ ^= 1;
  QUARRY_TRY(WriteFileAtomically(StatePath(), out.bytes()));  // which makes all names in the folder last
  ByteWriter note;
  note.Put(state_number_);
  note.Put(uint64_t{out.bytes().size()});
  note.Put(Checksum(out.bytes()));
  return note.Take();
}

/// What the file at hand has given that is no triangle yet.
Status SpillSink::SaveFile(ByteWriter& out) {
  out.Put(file_part_);
  out.Put(first_part_);
  out.Put(first_warning_);
  out.Put(loads_left_);
  out.Put(faces_to_next_load_);
  for (PagedFile* stream : {&*positions_, &*normals_, &*uvs_}) QUARRY_TRY(stream->Save(out));
  QUARRY_TRY(waiting_->Sync());
  out.Put(waiting_->count());
  out.Put<uint8_t>(has_all_);
  out.Put(resolved_);
  out.Put<uint8_t>(partial_.has_value());
  out.Put(partial_number_);
  if (partial_) QUARRY_TRY(partial_->Sync());
  out.Put(static_cast<uint32_t>(importer_state_.size()));
  out.PutArray(importer_state_);
  return {};
}

void SpillSink::Noted() {
  noted_ = true;
  noted_at_ = std::chrono::steady_clock::now();
  for (const SpillFile& file : superseded_) file.Remove();
  superseded_.clear();
}

Status SpillSink::Restore(std::span<const std::byte> saved, bool all) {
  ByteReader note(saved);
  state_number_ = note.Get<uint8_t>() & 1;
  const auto size = note.Get<uint64_t>(), checksum = note.Get<uint64_t>();
  const auto file = InputFile::Open(StatePath());
  Bytes state(file && note.done() && file->size() == size ? size : 0);
  if (state.empty() || !file->ReadAt(0, state) || Checksum(state) != checksum)
    return Fail(
        fmt::format("{}: is not what was saved of the import; begin anew without --resume", StatePath()));
  ByteReader in(state);
  scene_.attributes = static_cast<Attributes>(std::min<uint8_t>(in.Get<uint8_t>(), 3));
  has_offset_ = in.Get<uint8_t>() != 0;
  scene_.offset = in.GetVec3<glm::dvec3>();
  largest_loss_ = in.Get<double>();
  scene_.bounds.lower = in.GetVec3<glm::vec3>();
  scene_.bounds.upper = in.GetVec3<glm::vec3>();
  const auto count = in.Get<uint64_t>();
  scene_.input_triangles = in.Get<uint64_t>();
  scene_.dropped_degenerate = in.Get<uint64_t>();
  scene_.dropped_not_finite = in.Get<uint64_t>();
  default_material_ = in.Get<uint32_t>();
  scene_.materials = GetMaterials(in);
  scene_.parts = GetTexts(in);
  scene_.warnings = GetTexts(in);
  scene_.views = GetViews(in);
  QUARRY_TRY(images_.Restore(in));
  if (in.Get<uint8_t>() != 0) QUARRY_TRY(RestoreFile(in));
  scene_.sample.Restore(in);
  if (!in.done())
    return Fail(
        fmt::format("{}: what was saved of the import cannot be read; begin anew without --resume", folder_));
  noted_ = true;
  if (all) {
    scene_.triangles = SpillFile::Left(TrianglesPath(), RecordBytes(scene_.attributes), count);
    scene_.sample = {};
  } else {
    QUARRY_ASSIGN(scene_.triangles, OpenTrianglesFile(count));
  }
  RemoveStale();
  return {};
}

/// What a kill between a note and the removal of what it superseded has left.
void SpillSink::RemoveStale() const {
  std::vector<std::string> kept = {StatePath(), TrianglesPath()};
  if (in_file())
    for (const char* stream : {"positions", "normals", "uvs", "waiting"}) kept.push_back(FilePath(stream));
  if (partial_) kept.push_back(PartialPath(partial_number_));
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    const bool ours = name.starts_with("import-") || name.starts_with("triangles-");
    if (ours && std::ranges::find(kept, fmt::format("{}/{}", folder_, name)) == kept.end())
      std::filesystem::remove(entry.path(), error);
  }
}

Status SpillSink::RestoreFile(ByteReader& in) {
  file_noted_ = goes_on_ = true;
  file_part_ = in.Get<uint32_t>();
  first_part_ = in.Get<uint32_t>();
  first_warning_ = std::min(in.Get<uint32_t>(), static_cast<uint32_t>(scene_.warnings.size()));
  for (uint32_t i = first_part_; i < scene_.parts.size(); ++i) file_parts_.emplace(scene_.parts[i], i);
  loads_left_ = in.Get<uint32_t>();
  faces_to_next_load_ = in.Get<uint32_t>();
  QUARRY_ASSIGN(positions_, PagedFile::Restore(FilePath("positions"), sizeof(StoredPosition), in));
  QUARRY_ASSIGN(normals_, PagedFile::Restore(FilePath("normals"), sizeof(glm::vec3), in));
  QUARRY_ASSIGN(uvs_, PagedFile::Restore(FilePath("uvs"), sizeof(glm::vec2), in));
  const auto waiting = in.Get<uint64_t>();
  QUARRY_ASSIGN(waiting_, SpillFile::Open(FilePath("waiting"), sizeof(Face), waiting));
  has_all_ = in.Get<uint8_t>() != 0;
  resolved_ = in.Get<uint64_t>();
  const bool partial = in.Get<uint8_t>() != 0;
  partial_number_ = in.Get<uint8_t>() & 1;
  if (partial) {
    QUARRY_ASSIGN(partial_,
                  SpillFile::Open(PartialPath(partial_number_), RecordBytes(scene_.attributes), waiting));
  }
  const std::span<const std::byte> state = in.GetSpan(in.Get<uint32_t>());
  importer_state_.assign(state.begin(), state.end());
  asked_at_ = positions_->count() + scene_.input_triangles;
  return {};
}

}  // namespace quarry
