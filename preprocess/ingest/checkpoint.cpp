#include "preprocess/ingest/checkpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "common/base/file.h"

namespace quarry {

void ImportCheckpoints::Every(double seconds, std::function<Status()> make) {
  seconds_ = seconds;
  make_ = std::move(make);
}

void ImportCheckpoints::BeginFile(uint64_t elements, bool restored) {
  skips_file_ = false;
  made_in_file_ = restored;
  asked_at_ = elements;
}

void ImportCheckpoints::EndFile() {
  made_in_file_ = false;
  importer_state.clear();
}

bool ImportCheckpoints::Due(uint64_t elements) {
  constexpr uint64_t kElementsPerLook = 4096;
  if (elements - asked_at_ < kElementsPerLook || !enabled()) return false;
  asked_at_ = elements;
  const std::chrono::duration<double> since = std::chrono::steady_clock::now() - made_at_;
  return since.count() >= seconds_;
}

Status ImportCheckpoints::Make() {
  QUARRY_TRY(make_());
  made_in_file_ = true;
  return {};
}

std::string ImportCheckpoints::StatePath() const {
  return fmt::format("{}/import-state-{}", folder_, state_number_);
}

Result<Bytes> ImportCheckpoints::Write(const Bytes& state) {
  state_number_ ^= 1;
  QUARRY_TRY(WriteFileAtomically(StatePath(), state));  // which makes all names in the folder durable
  ByteWriter reference;
  reference.Put(state_number_);
  reference.Put(uint64_t{state.size()});
  reference.Put(Checksum(state));
  return reference.Take();
}

Result<Bytes> ImportCheckpoints::Read(std::span<const std::byte> reference) {
  ByteReader in(reference);
  state_number_ = in.Get<uint8_t>() & 1;
  const auto size = in.Get<uint64_t>(), checksum = in.Get<uint64_t>();
  const auto file = InputFile::Open(StatePath());
  Bytes state(file && in.done() && file->size() == size ? size : 0);
  if (state.empty() || !file->ReadAt(0, state) || Checksum(state) != checksum)
    return CannotResume(fmt::format("{}: has changed since the import saved it", StatePath()));
  made_ = true;
  return state;
}

void ImportCheckpoints::Committed() {
  made_ = true;
  made_at_ = std::chrono::steady_clock::now();
  for (const SpillFile& file : retired_) file.Remove();
  retired_.clear();
}

void ImportCheckpoints::Retire(SpillFile file, bool named) {
  if (named)
    retired_.push_back(std::move(file));
  else
    file.Remove();
}

void ImportCheckpoints::RemoveAllBut(std::vector<std::string> kept) const {
  kept.push_back(StatePath());
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    const bool ours = name.starts_with("import-") || name.starts_with("triangles-");
    if (ours && std::ranges::find(kept, fmt::format("{}/{}", folder_, name)) == kept.end())
      std::filesystem::remove(entry.path(), error);
  }
}

}  // namespace quarry
