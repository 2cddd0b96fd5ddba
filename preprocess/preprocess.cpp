#include "preprocess/preprocess.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include "common/base/cleanup.h"
#include "common/base/file_lock.h"
#include "common/base/output_path.h"
#include "common/base/progress.h"
#include "common/base/resource.h"
#include "common/base/version.h"
#include "common/kdtree/triangle_test.h"
#include "common/voxel/store_format.h"
#include "common/voxel/voxel_block.h"
#include "preprocess/import/file_identity.h"
#include "preprocess/import/importer.h"
#include "preprocess/ingest/spill_sink.h"
#include "preprocess/partition/partition.h"
#include "preprocess/partition/regions.h"
#include "preprocess/partition/split.h"
#include "preprocess/partition/voxel_builder.h"
#include "preprocess/partition/voxel_pipeline.h"
#include "preprocess/work_folder.h"

namespace quarry {
namespace {

using Clock = std::chrono::steady_clock;

/// Of notes, and of whatever a result depends on that no option says.
constexpr int kJournalVersion = 5;

std::string Command(const PreprocessOptions& options) {
  std::string command = fmt::format(
      "version {}\nformat {}\nimport {}\njournal {}\nLZ4 {}\n--tmp {}\n--voxel-size {}\n--scale {}\n--up "
      "{}\n{}",
      kVersion, kStoreVersion, kImportVersion, kJournalVersion, CompressorVersion(), options.tmp_folder,
      options.voxel_size, options.scale, options.up_axis == 1 ? "y" : "z",
      options.textures ? "" : "--no-textures\n");
  for (const auto& [model, p] : options.placements)
    command += fmt::format("--place {}={},{},{},{},{}\n", model, p.translation.x, p.translation.y,
                           p.translation.z, p.turn_degrees, p.scale);
  return command;
}

/// Imports what the notes do not have.
class Import {
 public:
  Import(const PreprocessOptions& options, WorkFolder& work, Progress& progress)
      : options_(options),
        work_(work),
        progress_(progress),
        sink_(
            work.spill_folder(), options.memory, options.scale,
            [&](const std::string& text) { progress_.Say("warning: " + text); }, options.textures) {
    sink_.NoteEvery(options.checkpoint_seconds, [this] { return AddNote(); });
  }

  /// Takes over what the notes say. Errors: they do not fit these options and models.
  Status Restore() {
    const Note* last = nullptr;
    bool all = false;
    for (const Note& note : work_.notes()) {
      if (note.kind == NoteKind::kImported) last = &note;
      all |= note.kind == NoteKind::kRegions;
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
    if (!in.ok() || now != identities_ || begun < models_ || (all && models_ != options_.models.size()))
      return Fail(fmt::format(
          "{}: was begun with other models, or they have changed since; begin anew without --resume",
          work_.path()));
    progress_.Say(fmt::format("going on with {}", work_.path()));
    return sink_.Restore(in.GetSpan(in.remaining()), all);
  }

  Result<ImportedScene> Run() {
    for (size_t i = models_; i < options_.models.size(); ++i) {
      const std::string reading = fmt::format("reading {}", options_.models[i]);
      progress_.Say(reading);
      // What an earlier run has read of it is passed over at once.
      sink_.OnRead([&, begun = false](uint64_t done, uint64_t total) mutable {
        if (!std::exchange(begun, true)) progress_.Begin(reading, "bytes", done);
        progress_.Update(done, total);
      });
      if (!sink_.in_file()) identities_ += FileIdentity(options_.models[i]) + '\n';
      const auto placement = options_.placements.find(options_.models[i]);
      sink_.Place(placement == options_.placements.end() ? Placement{} : placement->second,
                  static_cast<int>(options_.up_axis));
      QUARRY_TRY(ImportModel(options_.models[i], sink_,
                             ForeignFormatsOf(options_, work_.spill_folder() + "/foreign"),
                             options_.unpack_limit));
      progress_.End();
      ++models_;
      const bool last = models_ == options_.models.size();
      if ((last ? sink_.spills() : SecondsSince(noted_at_) >= options_.checkpoint_seconds) ||
          sink_.must_note())
        QUARRY_TRY(AddNote());
    }
    return sink_.Finish();
  }

 private:
  Status AddNote() {
    ByteWriter note;
    note.Put(models_);
    note.Put(models_ + uint32_t{sink_.in_file()});
    note.Put(static_cast<uint32_t>(identities_.size()));
    note.PutArray(identities_);
    QUARRY_ASSIGN(const Bytes state, sink_.Save());
    note.PutArray(state);
    QUARRY_TRY(work_.Add(NoteKind::kImported, note.Take()));
    sink_.Noted();
    noted_at_ = Clock::now();
    return {};
  }

  const PreprocessOptions& options_;
  WorkFolder& work_;
  Progress& progress_;
  SpillSink sink_;
  uint32_t models_ = 0;     ///< wholly read
  std::string identities_;  ///< of those, and the one being read
  Clock::time_point noted_at_ = Clock::now();
};

SceneMeta MakeMeta(const ImportedScene& scene, const PreprocessOptions& options) {
  SceneMeta meta;
  meta.offset = scene.offset;
  meta.bounds_lower = scene.bounds.lower;
  meta.bounds_upper = scene.bounds.upper;
  float largest = 0;
  for (int a = 0; a < 3; ++a)
    largest = std::max({largest, std::fabs(scene.bounds.lower[a]), std::fabs(scene.bounds.upper[a])});
  meta.padding = ReferencePadding(largest);
  meta.root_lower = scene.bounds.lower - glm::vec3(2 * meta.padding);
  meta.root_upper = scene.bounds.upper + glm::vec3(2 * meta.padding);
  meta.up_axis = options.up_axis;
  meta.input_triangles = scene.input_triangles;
  meta.dropped_degenerate = scene.dropped_degenerate;
  meta.dropped_not_finite = scene.dropped_not_finite;
  meta.voxel_size = options.voxel_size;
  return meta;
}

/// From triangles to voxels in the store: all at once when memory holds them; else parted into regions on
/// disk, then region by region.
class Build {
 public:
  Build(const PreprocessOptions& options, WorkFolder& work, Progress& progress, ImportedScene& scene)
      : options_(options),
        work_(work),
        progress_(progress),
        scene_(scene),
        meta_(MakeMeta(scene, options)),
        textures_(scene.images, ImageDecodingOf(options), options.threads,
                  [&](const std::string& text) { progress_.Say("warning: " + text); }) {
    whole_.cell = {meta_.root_lower, meta_.root_upper};
    partition_.padding = meta_.padding;
    partition_.voxel_size = options.voxel_size;
    partition_.memory = options.memory / 4;
    partition_.spill_prefix = work.spill_folder() + "/region-";
  }

  Status Run() {
    const uint64_t triangles = scene_.triangles->count();
    if (triangles > kMostInMemory) {
      QUARRY_TRY(TakeNotes());
      QUARRY_TRY(Part());
    } else {
      tree_ = {{KdNode{}}, {whole_}, {0}};
    }
    QUARRY_ASSIGN(StoreWriter writer,
                  StoreWriter::Continue(options_.output, work_.store(), std::move(stored_)));
    writer_.emplace(std::move(writer));
    for (const VoxelEntry& v : writer_->directory()) emitted_ += v.triangles;
    // Progress is told by what has been read: what is built has copies.
    uint64_t all = triangles, before = 0;
    if (files_) {
      const std::vector<uint64_t> counts = files_->counts();
      all = std::accumulate(counts.begin(), counts.end(), uint64_t{0});
      before = std::accumulate(counts.begin(), counts.begin() + static_cast<ptrdiff_t>(parts_.size()),
                               uint64_t{0});
    }
    progress_.Begin(fmt::format("building voxels of {} triangles", triangles), "triangles", before);
    VoxelPipeline pipeline(
        options_.threads,
        [&](const VoxelTask& task) {
          EncodedVoxel voxel = BuildVoxel(task.triangles, task.cell, meta_.padding,
                                          scene_.attributes != Attributes::kNone, options_.voxel_size);
          voxel.chained = task.chained;
          return voxel;
        },
        [&](const EncodedVoxel& voxel) { return writer_->AddVoxel(voxel); });
    noted_at_ = Clock::now();
    for (size_t i = parts_.size(); i < tree_.regions.size(); ++i) {
      const SpillFile& file = files_ ? files_->file(i) : *scene_.triangles;
      const Box content = files_ ? files_->contents()[i] : whole_.cell;
      PartitionOptions inner = partition_;
      inner.spill_prefix += fmt::format("{}-", i);
      uint64_t emitted = 0;
      QUARRY_ASSIGN(TopSubtree part,
                    PartitionFile(file, tree_.regions[i], content, inner, [&](VoxelTask task) {
                      emitted += task.triangles.size();
                      progress_.Update(before + std::min(emitted, file.count()), all);
                      return pipeline.Add(std::move(task));
                    }));
      emitted_ += emitted;
      before += file.count();
      parts_.push_back(std::move(part));
      if (files_) QUARRY_TRY(NoteBuilt());
    }
    QUARRY_TRY(pipeline.Finish());
    progress_.End();
    if (files_ && !scene_.images.empty()) QUARRY_TRY(NoteBuilt(true));
    return textures_.Run(*writer_, progress_, [&](const Bytes& note) {
      return work_.kept() ? work_.Add(NoteKind::kTextures, note) : Status{};
    });
  }

  Status Finish(PreprocessStatistics& statistics) {
    std::vector<KdNode> top = tree_.nodes;
    uint32_t voxels = 0;
    for (size_t i = 0; i < parts_.size(); ++i) {
      Graft(parts_[i], tree_.leaves[i], voxels, top);
      voxels += parts_[i].voxels;
    }
    statistics.voxels = writer_->voxel_count();
    statistics.stored_references = emitted_;
    statistics.top_tree_nodes = static_cast<uint32_t>(top.size());
    statistics.top_tree_depth = DepthOf(top);
    statistics.meta = meta_;
    statistics.textures = textures_.Statistics(*writer_);
    statistics.warnings += statistics.textures.left_out;
    textures_.Renumber(scene_.materials);
    QUARRY_ASSIGN(statistics.scene_id,
                  writer_->Finish(meta_, top, scene_.materials, scene_.parts, scene_.views));
    statistics.store_bytes = writer_->bytes_written();
    return {};
  }

 private:
  /// Steps from the root to the deepest leaf. Children lie beyond their parents.
  static uint32_t DepthOf(const std::vector<KdNode>& nodes) {
    std::vector<uint32_t> depth(nodes.size());
    uint32_t deepest = 0;
    for (size_t i = 0; i < nodes.size(); ++i) {
      deepest = std::max(deepest, depth[i]);
      if (!nodes[i].is_leaf()) depth[nodes[i].left()] = depth[nodes[i].left() + 1] = depth[i] + 1;
    }
    return deepest;
  }

  /// What an earlier run has done of this.
  Status TakeNotes() {
    for (const Note& note : work_.notes()) {
      ByteReader in(note.bytes);
      if (note.kind == NoteKind::kRegions) {
        const auto nodes = in.Get<uint32_t>(), regions = in.Get<uint32_t>();
        tree_ = {in.GetArray<KdNode>(nodes), in.GetArray<Region>(regions), in.GetArray<uint32_t>(regions)};
      } else if (note.kind == NoteKind::kParted) {
        parted_ = in.Get<uint64_t>();
        counts_ = in.GetArray<uint64_t>(tree_.regions.size());
        contents_ = in.GetArray<Box>(tree_.regions.size());
      } else if (note.kind == NoteKind::kBuilt) {
        TopSubtree part;
        part.voxels = in.Get<uint32_t>();
        part.nodes = in.GetArray<KdNode>(in.Get<uint32_t>());
        for (const VoxelEntry& v : in.GetArray<VoxelEntry>(part.voxels)) stored_.directory.push_back(v);
        for (const uint64_t v : in.GetArray<uint64_t>(2 * part.voxels)) stored_.logical.push_back(v);
        parts_.push_back(std::move(part));
      } else if (note.kind == NoteKind::kTextures) {
        if (!textures_.TakeNote(note.bytes, stored_.textures))
          return Fail(
              fmt::format("{}: its journal cannot be read; begin anew without --resume", work_.path()));
        continue;
      } else {
        continue;
      }
      if (!in.done())
        return Fail(fmt::format("{}: its journal cannot be read; begin anew without --resume", work_.path()));
    }
    if (!stored_.directory.empty()) {
      const BlockEntry& hot = stored_.directory.back().blocks[0];
      stored_.bytes = hot.offset + hot.stored + stored_.directory.back().blocks[1].stored;
    }
    for (const WrittenTexture& t : stored_.textures)
      for (const BlockEntry& page : t.texture.pages)
        stored_.bytes = std::max(stored_.bytes, page.offset + page.stored);
    noted_regions_ = parts_.size();
    noted_voxels_ = static_cast<uint32_t>(stored_.directory.size());
    return {};
  }

  Status ChooseTree() {
    const uint64_t weight = scene_.sample.weight();
    tree_ = ChooseRegions(scene_.sample.TakeTriangles(), weight, meta_.padding, whole_);
    ByteWriter note;
    note.Put(static_cast<uint32_t>(tree_.nodes.size()));
    note.Put(static_cast<uint32_t>(tree_.regions.size()));
    note.PutArray(tree_.nodes);
    note.PutArray(tree_.regions);
    note.PutArray(tree_.leaves);
    return work_.Add(NoteKind::kRegions, note.Take());
  }

  /// Hands all triangles out to the files of their regions. The spill they come from shrinks meanwhile.
  Status Part() {
    if (tree_.regions.empty()) QUARRY_TRY(ChooseTree());
    QUARRY_ASSIGN(files_, RegionFiles::Open(tree_, partition_.spill_prefix, RecordBytes(scene_.attributes),
                                            partition_.memory, noted_regions_, counts_, contents_));
    const uint64_t triangles = scene_.triangles->count();
    // A kill may have come between a note and this.
    if (parted_ > 0 && parted_ < triangles) scene_.triangles->Discard(0, parted_);
    progress_.Begin("parting triangles", "triangles", parted_);
    while (parted_ < triangles) {
      const uint64_t end = std::min(parted_ + kPartedAtOnce, triangles);
      QUARRY_TRY(files_->Add(*scene_.triangles, parted_, end, meta_.padding,
                             [&](uint64_t done) { progress_.Update(done, triangles); }));
      QUARRY_TRY(files_->Sync());
      ByteWriter note;
      note.Put(end);
      note.PutArray(files_->counts());
      note.PutArray(files_->contents());
      QUARRY_TRY(work_.Add(NoteKind::kParted, note.Take()));
      scene_.triangles->Discard(parted_, end);
      parted_ = end;
    }
    progress_.End();
    scene_.triangles->Remove();
    CutOffEmptySpace(files_->contents(), whole_.cell, tree_);
    return files_->FinishWriting();
  }

  /// Notes the regions whose voxels have all been delivered, once that is worth a synchronisation.
  Status NoteBuilt(bool now = false) {
    if (noted_regions_ == parts_.size() || (!now && SecondsSince(noted_at_) < options_.checkpoint_seconds))
      return {};
    if (noted_voxels_ + parts_[noted_regions_].voxels > writer_->voxel_count()) return {};
    QUARRY_TRY(writer_->Sync());
    while (noted_regions_ < parts_.size() &&
           noted_voxels_ + parts_[noted_regions_].voxels <= writer_->voxel_count()) {
      const TopSubtree& part = parts_[noted_regions_];
      ByteWriter note;
      note.Put(part.voxels);
      note.Put(static_cast<uint32_t>(part.nodes.size()));
      note.PutArray(part.nodes);
      note.PutArray(std::span(writer_->directory()).subspan(noted_voxels_, part.voxels));
      note.PutArray(std::span(writer_->logical()).subspan(2 * noted_voxels_, 2 * part.voxels));
      QUARRY_TRY(work_.Add(NoteKind::kBuilt, note.Take()));
      files_->file(noted_regions_).Remove();
      noted_voxels_ += part.voxels;
      ++noted_regions_;
    }
    noted_at_ = Clock::now();
    return {};
  }

  const PreprocessOptions& options_;
  WorkFolder& work_;
  Progress& progress_;
  ImportedScene& scene_;
  const SceneMeta meta_;
  Region whole_;
  PartitionOptions partition_;

  RegionTree tree_;
  std::optional<RegionFiles> files_;  ///< unless there is but one region
  uint64_t parted_ = 0;
  std::vector<uint64_t> counts_;  ///< of an earlier run, as contents_
  std::vector<Box> contents_;

  TextureStage textures_;
  std::optional<StoreWriter> writer_;
  StoreProgress stored_;
  std::vector<TopSubtree> parts_;  ///< of the regions that have been split into voxels
  uint64_t emitted_ = 0;
  size_t noted_regions_ = 0;
  uint32_t noted_voxels_ = 0;
  Clock::time_point noted_at_;
};

/// The import of a work folder, with what an earlier run has done of it.
struct Begun {
  WorkFolder work;
  std::unique_ptr<Import> import;
};

Result<std::unique_ptr<Begun>> Begin(const PreprocessOptions& options, bool resume, Progress& progress) {
  QUARRY_ASSIGN(WorkFolder work, WorkFolder::Open(options.output, options.tmp_folder, Command(options),
                                                  resume, options.goes_on));
  auto begun = std::make_unique<Begun>(Begun{std::move(work), nullptr});
  begun->import = std::make_unique<Import>(options, begun->work, progress);
  QUARRY_TRY(begun->import->Restore());
  return begun;
}

Result<PreprocessStatistics> RunIn(Begun& begun, const PreprocessOptions& options, Progress& progress) {
  const auto start = Clock::now();
  QUARRY_ASSIGN(ImportedScene scene, begun.import->Run());
  begun.import.reset();
  QUARRY_TRY(CheckNotRead(options.output));  // what models name is known now
  PreprocessStatistics statistics;
  statistics.import_wall_s = SecondsSince(start);
  statistics.warnings = scene.warnings.size();
  const auto build_start = Clock::now();
  Build build(options, begun.work, progress, scene);
  QUARRY_TRY(build.Run());
  QUARRY_TRY(build.Finish(statistics));
  statistics.build_wall_s = SecondsSince(build_start);
  statistics.preprocess_wall_s = SecondsSince(start);
  statistics.peak_rss_bytes = PeakResidentBytes();
  return statistics;
}

}  // namespace

Result<PreprocessStatistics> Preprocess(const PreprocessOptions& options) {
  // The output first: an unwritable place should not cost an import.
  QUARRY_ASSIGN(const FileLock lock, FileLock::Take(options.output, "another quarry-preprocess"));
  using Resume = PreprocessOptions::Resume;
  Progress progress(options.quiet);
  auto opened = Begin(options, options.resume != Resume::kNo, progress);
  if (!opened && options.resume == Resume::kIfFit) opened = Begin(options, false, progress);
  if (!opened) return tl::unexpected<Error>(opened.error());
  Begun& begun = **opened;
  auto statistics = RunIn(begun, options, progress);
  if (statistics) {
    begun.work.Remove();
    TellOnSignal(options.output + " is written");
  } else if (begun.work.kept() && statistics.error().message.find("--resume") == std::string::npos)
    statistics.error().message +=
        fmt::format("; what is done is kept in {}: {}", begun.work.path(), options.goes_on);
  return statistics;
}

}  // namespace quarry
