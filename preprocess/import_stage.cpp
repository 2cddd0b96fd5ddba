#include "preprocess/import_stage.h"

#include <fmt/format.h>

#include <utility>
#include <vector>

#include "common/base/resource.h"
#include "preprocess/import/files/model_files.h"
#include "preprocess/import/importer.h"
#include "preprocess/spill/saved_tables.h"

namespace quarry {

ImportStage::ImportStage(const PreprocessOptions& options, WorkFolder& work, Progress& progress)
    : options_(options),
      work_(work),
      progress_(progress),
      sink_(
          work.spill_folder(), options.memory, options.scale,
          [&](const std::string& text) { progress_.Say("warning: " + text); }, options.textures,
          PreviewFile::Wanted(options.up_axis, options.up_habit.evidence()), options.threads) {
  if (options.models.size() > 1) sink_.KeepFilesApart();
}

Status ImportStage::Restore() {
  const SavedCheckpoint* last = nullptr;
  bool routed = false;
  for (const SavedCheckpoint& checkpoint : work_.checkpoints()) {
    if (checkpoint.kind == CheckpointKind::kImported) last = &checkpoint;
    routed |= checkpoint.kind == CheckpointKind::kRegions;
  }
  if (!last) {
    if (options_.resume == PreprocessOptions::Resume::kYes)
      progress_.Say("there is nothing to continue: starting from the beginning");
    return {};
  }
  ByteReader in(last->bytes);
  const std::vector<std::string> models = GetTexts(in);
  if (models != options_.models)
    return CannotResume(fmt::format("{}: was begun with other models", work_.path()));
  for (auto n = in.Get<uint32_t>(); n > 0 && in.ok(); --n) {
    ModelFile file;
    file.path = GetText(in);
    file.there = in.Get<uint8_t>() != 0;
    file.bytes = in.Get<uint64_t>();
    file.changed_ns = in.Get<int64_t>();
    file.status_changed_ns = in.Get<int64_t>();
    if (in.ok() && !RestoreModelFile(file))
      return CannotResume(fmt::format("{}: has changed since the run began", file.path));
  }
  progress_.Say(fmt::format("continuing {}", work_.path()));
  restored_ = true;
  return sink_.Restore(in.GetSpan(in.remaining()), routed);
}

Result<ImportedScene> ImportStage::Run() {
  for (const std::string& model : options_.models) {
    progress_.BeginStage(StageShares::kReading / static_cast<double>(options_.models.size()));
    if (restored_) continue;
    const std::string reading = fmt::format("reading {}", model);
    progress_.Say(reading);
    sink_.OnRead([&, begun = false](uint64_t done, uint64_t total) mutable {
      if (!std::exchange(begun, true)) progress_.Begin(reading, "bytes");
      progress_.Update(done, total);
    });
    NoteModelFile(model);
    sink_.Place(PlacementOf(options_, model), static_cast<int>(PlacedAbout(options_)));
    QUARRY_TRY(ImportModel(model, sink_, ForeignFormatsOf(options_, work_.spill_folder() + "/foreign"),
                           options_.unpack_limit, GltfDecodingOf(options_, work_.spill_folder()),
                           CadReadingOf(options_, work_.spill_folder())));
    progress_.End();
  }
  if (!restored_ && sink_.spills()) QUARRY_TRY(AddCheckpoint());
  return sink_.Finish();
}

Status ImportStage::AddCheckpoint() {
  ByteWriter checkpoint;
  PutTexts(options_.models, checkpoint);
  const std::vector<ModelFile> files = ModelFiles();
  checkpoint.Put(static_cast<uint32_t>(files.size()));
  for (const ModelFile& file : files) {
    PutText(file.path, checkpoint);
    checkpoint.Put<uint8_t>(file.there);
    checkpoint.Put(file.bytes);
    checkpoint.Put(file.changed_ns);
    checkpoint.Put(file.status_changed_ns);
  }
  QUARRY_ASSIGN(const Bytes state, sink_.Save());
  checkpoint.PutArray(state);
  return work_.Add(CheckpointKind::kImported, checkpoint.Take());
}

}  // namespace quarry
