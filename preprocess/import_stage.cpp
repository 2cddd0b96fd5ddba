#include "preprocess/import_stage.h"

#include <fmt/format.h>

#include <utility>

#include "common/base/resource.h"
#include "preprocess/import/files/file_identity.h"
#include "preprocess/import/importer.h"

namespace quarry {

ImportStage::ImportStage(const PreprocessOptions& options, WorkFolder& work, Progress& progress)
    : options_(options),
      work_(work),
      progress_(progress),
      sink_(
          work.spill_folder(), options.memory, options.scale,
          [&](const std::string& text) { progress_.Say("warning: " + text); }, options.textures) {
  sink_.CheckpointEvery(options.checkpoint_seconds, [this] { return AddCheckpoint(); });
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
      progress_.Say("nothing is there to go on with: beginning anew");
    return {};
  }
  ByteReader in(last->bytes);
  models_ = in.Get<uint32_t>();
  const auto begun = in.Get<uint32_t>();
  identities_ = AsText(in.GetSpan(in.Get<uint32_t>()));
  std::string now;
  for (size_t i = 0; i < begun && i < options_.models.size(); ++i)
    now += FileIdentity(options_.models[i]) + '\n';
  if (!in.ok() || now != identities_ || begun < models_ || (routed && models_ != options_.models.size()))
    return CannotResume(
        fmt::format("{}: was begun with other models, or they have changed since", work_.path()));
  progress_.Say(fmt::format("going on with {}", work_.path()));
  return sink_.Restore(in.GetSpan(in.remaining()), routed);
}

Result<ImportedScene> ImportStage::Run() {
  for (size_t i = models_; i < options_.models.size(); ++i) {
    const std::string reading = fmt::format("reading {}", options_.models[i]);
    progress_.Say(reading);
    // A resumed import skips the bytes that an earlier run has read: progress starts behind them.
    sink_.OnRead([&, begun = false](uint64_t done, uint64_t total) mutable {
      if (!std::exchange(begun, true)) progress_.Begin(reading, "bytes", done);
      progress_.Update(done, total);
    });
    if (!sink_.in_file()) identities_ += FileIdentity(options_.models[i]) + '\n';
    sink_.Place(PlacementOf(options_, options_.models[i]), static_cast<int>(PlacedAbout(options_)));
    QUARRY_TRY(ImportModel(options_.models[i], sink_,
                           ForeignFormatsOf(options_, work_.spill_folder() + "/foreign"),
                           options_.unpack_limit, GltfDecodingOf(options_, work_.spill_folder()),
                           CadReadingOf(options_, work_.spill_folder())));
    progress_.End();
    ++models_;
    const bool last = models_ == options_.models.size();
    if ((last ? sink_.spills() : SecondsSince(saved_at_) >= options_.checkpoint_seconds) || sink_.must_save())
      QUARRY_TRY(AddCheckpoint());
  }
  return sink_.Finish();
}

Status ImportStage::AddCheckpoint() {
  ByteWriter checkpoint;
  checkpoint.Put(models_);
  checkpoint.Put(models_ + uint32_t{sink_.in_file()});
  checkpoint.Put(static_cast<uint32_t>(identities_.size()));
  checkpoint.PutArray(identities_);
  QUARRY_ASSIGN(const Bytes state, sink_.Save());
  checkpoint.PutArray(state);
  QUARRY_TRY(work_.Add(CheckpointKind::kImported, checkpoint.Take()));
  sink_.Committed();
  saved_at_ = Clock::now();
  return {};
}

}  // namespace quarry
