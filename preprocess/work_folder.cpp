#include "preprocess/work_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

#include "common/base/cleanup.h"
#include "common/base/file.h"
#include "common/base/resource.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

// Records that are no checkpoints. The first two of every journal:
constexpr uint32_t kCommand = 0, kBoot = 0x100;
constexpr uint32_t kDurable = 0x101;  // this and all before it survive a loss of power
constexpr uint32_t kHeaderBytes = 16;

Bytes Framed(uint32_t kind, std::span<const std::byte> bytes) {
  ByteWriter out;
  out.Put(kind);
  out.Put(static_cast<uint32_t>(bytes.size()));
  out.Put(Checksum(bytes) ^ kind);
  out.PutArray(bytes);
  return out.Take();
}

/// How the names of the files begin that grow before a checkpoint. Null: none does; empty: all do.
const char* FilesOf(CheckpointKind kind) {
  switch (kind) {
    case CheckpointKind::kRegions:
      return nullptr;
    case CheckpointKind::kRouted:
      return "region-";
    case CheckpointKind::kSmoothed:
      return "border-";
    case CheckpointKind::kBuilt:
    case CheckpointKind::kTextures:
      return "store";
    case CheckpointKind::kImported:
      break;
  }
  return "";
}

/// The records of a journal up to the first torn record; `whole`: bytes up to there.
std::vector<SavedCheckpoint> ReadJournal(std::span<const std::byte> journal, size_t& whole) {
  std::vector<SavedCheckpoint> notes;
  for (whole = 0; journal.size() - whole >= kHeaderBytes;) {
    ByteReader in(journal.subspan(whole));
    const auto kind = in.Get<uint32_t>();
    const auto size = in.Get<uint32_t>();
    const auto checksum = in.Get<uint64_t>();
    const auto bytes = in.GetSpan(size);
    if (!in.ok() || (Checksum(bytes) ^ kind) != checksum) break;
    notes.push_back({static_cast<CheckpointKind>(kind), Bytes(bytes.begin(), bytes.end())});
    whole += kHeaderBytes + size;
  }
  return notes;
}

/// The first line of `now` that differs in `then`.
std::string FirstDifference(const std::string& then, const std::string& now) {
  std::istringstream a(then), b(now);
  std::string x, y;
  while (std::getline(b, y))
    if (!std::getline(a, x) || x != y) return fmt::format("\"{}\", now \"{}\"", x, y);
  return "more options";
}

/// Removes a run's own files and nothing else. The journal goes first: while it exists, the files it names
/// must, too.
void RemoveFiles(const std::string& folder) {
  std::error_code error;
  fs::remove(folder + "/journal", error);
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name == "store" || name == "images" || name == "cut-outs" || name.starts_with("triangles-") ||
        name.starts_with("region-") || name.starts_with("border-") || name.starts_with("import-") ||
        name.starts_with("foreign."))
      fs::remove(entry.path(), error);
  }
  fs::remove(folder, error);  // only if it is empty
}

/// Outputs of the same name in different folders may share `spill`.
std::string SpillFolderFor(const std::string& output, const std::string& spill) {
  std::error_code error;
  const std::string whole = fs::weakly_canonical(output, error).string();
  return BesidePath(spill + "/" + fs::path(output).filename().string(),
                    fmt::format("-{:016x}.work", Checksum(AsBytes(error ? output : whole))));
}

Status MakeFolder(const std::string& path) {
  if (::mkdir(path.c_str(), 0755) != 0 && errno != EEXIST)
    return Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(errno)));
  return {};
}

}  // namespace

Result<WorkFolder> WorkFolder::Open(const std::string& output, const std::string& spill,
                                    const std::string& command, bool resume, const std::string& goes_on,
                                    Durability durability) {
  WorkFolder folder;
  folder.durability_ = std::move(durability);
  folder.path_ = BesidePath(output, ".work");
  folder.spill_ = spill.empty() ? folder.path_ : SpillFolderFor(output, spill);
  const std::string left = "the finished part is kept in " + folder.path_ + ": " + goes_on;
  ReportIfLeft(folder.path_, left);
  if (folder.spill_ != folder.path_) ReportIfLeft(folder.spill_, left);
  if (resume) {
    QUARRY_ASSIGN(const bool going_on, folder.GoOn(command));
    if (going_on) return folder;
  }
  QUARRY_TRY(folder.Begin(command));
  return folder;
}

WorkFolder::WorkFolder(WorkFolder&& other) noexcept
    : path_(std::move(other.path_)),
      spill_(std::move(other.spill_)),
      journal_(std::exchange(other.journal_, -1)),
      durability_(std::move(other.durability_)),
      opened_(other.opened_),
      durable_(other.durable_),
      checkpoints_(std::move(other.checkpoints_)),
      kept_(other.kept_),
      cleanups_(std::move(other.cleanups_)) {}

WorkFolder::~WorkFolder() {
  if (journal_ >= 0 && !kept_) Remove();
  if (journal_ >= 0) ::close(journal_);
}

Status WorkFolder::Begin(const std::string& command) {
  durable_ = false;
  std::error_code none;
  // Its removal is durable before the files that it names go.
  if (fs::remove(path_ + "/journal", none)) SyncFolderOf(path_ + "/");
  RemoveFiles(path_);
  RemoveFiles(spill_);
  const std::string name = path_ + "/journal";
  const SignalsHeld held;
  HoldOnSignal();
  QUARRY_TRY(MakeFolder(path_));
  if (Status made = MakeFolder(spill_); !made) {
    RemoveFiles(path_);
    return made;
  }
  journal_ = ::open(name.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0644);
  if (journal_ < 0) return Fail(fmt::format("{}: cannot write: {}", name, ErrnoText(errno)));
  QUARRY_TRY(Append(Framed(kCommand, AsBytes(command))));
  return Append(Framed(kBoot, AsBytes(durability_.boot)));
}

/// Whether the system has been started anew since, and checkpoints were not durable yet.
bool WorkFolder::WasLost(std::span<const SavedCheckpoint> journal) const {
  if (journal.size() < 2) return true;
  const bool same_boot = !durability_.boot.empty() && AsText(journal[1].bytes) == durability_.boot;
  return !same_boot &&
         std::ranges::find(journal, CheckpointKind{kDurable}, &SavedCheckpoint::kind) == journal.end();
}

/// False: there is nothing to continue.
Result<bool> WorkFolder::GoOn(const std::string& command) {
  const std::string name = path_ + "/journal";
  if (::access(name.c_str(), F_OK) != 0) return false;
  QUARRY_ASSIGN(const InputFile file, InputFile::Open(name));
  Bytes bytes(file.size());
  QUARRY_TRY(file.ReadAt(0, bytes));
  size_t whole = 0;
  checkpoints_ = ReadJournal(bytes, whole);
  const bool building = std::any_of(
      checkpoints_.begin(), checkpoints_.end(),
      [](const SavedCheckpoint& checkpoint) { return checkpoint.kind == CheckpointKind::kBuilt; });
  // Killed after the store got its name: the run is complete, and nothing is left to continue.
  const bool named = building && ::access(store().c_str(), F_OK) != 0;
  const bool lost = WasLost(checkpoints_);
  if (checkpoints_.size() <= 2 || named || lost) {
    checkpoints_.clear();
    return false;
  }
  const std::string then(AsText(checkpoints_[0].bytes));
  if (then != command)
    return tl::unexpected<Error>(
        Error{fmt::format("{}: was begun with {}; repeat that, or start again without --resume", path_,
                          FirstDifference(then, command)),
              ErrorKind::kCannotResume});
  checkpoints_.erase(checkpoints_.begin(), checkpoints_.begin() + 2);
  durable_ = std::erase_if(checkpoints_, [](const SavedCheckpoint& checkpoint) {
               return checkpoint.kind == CheckpointKind{kDurable};
             }) > 0;
  if (checkpoints_.empty()) return false;
  journal_ = ::open(name.c_str(), O_RDWR | O_APPEND | O_CLOEXEC);
  if (journal_ < 0 || ::ftruncate(journal_, static_cast<off_t>(whole)) != 0)
    return Fail(fmt::format("{}: cannot write: {}", name, ErrnoText(errno)));
  KeepOnSignal();
  return true;
}

Status WorkFolder::Add(CheckpointKind kind, std::span<const Bytes> checkpoints) {
  const bool durable = durable_ || durability_.boot.empty() || SecondsSince(opened_) >= durability_.after_s;
  if (durable) QUARRY_TRY(MakeDurable(kind));
  for (const Bytes& checkpoint : checkpoints)
    QUARRY_TRY(Append(Framed(static_cast<uint32_t>(kind), checkpoint)));
  if (durable && ::fsync(journal_) != 0 && errno != EINVAL && errno != EROFS)
    return Fail(fmt::format("{}/journal: cannot write: {}", path_, ErrnoText(errno)));
  KeepOnSignal();
  return {};
}

/// Makes the files of a checkpoint durable. The first time it makes all files durable, and notes that in the
/// journal.
Status WorkFolder::MakeDurable(CheckpointKind kind) {
  const char* const start = durable_ ? FilesOf(kind) : "";
  if (!start) return {};
  QUARRY_TRY(SyncFilesIn(path_, start));
  if (spill_ != path_) QUARRY_TRY(SyncFilesIn(spill_, start));
  if (std::exchange(durable_, true)) return {};
  for (const std::string& made : {path_, spill_}) SyncFolderOf(made);
  return Append(Framed(kDurable, {}));
}

Status WorkFolder::Append(std::span<const std::byte> record) {
  while (!record.empty()) {
    const ssize_t n = ::write(journal_, record.data(), record.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0)
      return Fail(fmt::format("{}/journal: cannot write: {}", path_, ErrnoText(n < 0 ? errno : ENOSPC)));
    record = record.subspan(static_cast<size_t>(n));
  }
  return {};
}

std::string WorkFolder::BootId() {
  std::ifstream file("/proc/sys/kernel/random/boot_id");
  std::string id;
  std::getline(file, id);
  return id;
}

void WorkFolder::HoldOnSignal() {
  for (const char* file : {"/journal", "/store"}) cleanups_.push_back(RemoveOnSignal(path_ + file));
  for (const char* file : {"/triangles-0", "/triangles-1", "/triangles-2", "/triangles-3",
                           "/import-positions", "/import-normals", "/import-uvs", "/import-waiting",
                           "/import-partial-0", "/import-partial-1", "/import-state", "/images"})
    cleanups_.push_back(RemoveOnSignal(spill_ + file));
  cleanups_.push_back(RemoveFolderOnSignal(spill_));  // with images of foreign models
  if (spill_ != path_) cleanups_.push_back(RemoveOnSignal(path_));
}

void WorkFolder::KeepOnSignal() {
  if (std::exchange(kept_, true)) return;
  const SignalsHeld held;  // so that all of it goes, or all of it stays
  for (const int cleanup : std::exchange(cleanups_, {})) Forget(cleanup);
}

void WorkFolder::Remove() {
  RemoveFiles(path_);
  if (path_ != spill_) RemoveFiles(spill_);
  for (const int cleanup : std::exchange(cleanups_, {})) Forget(cleanup);
  kept_ = true;
}

}  // namespace quarry
