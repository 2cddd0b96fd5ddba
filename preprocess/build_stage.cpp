#include "preprocess/build_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <span>
#include <system_error>

#include "common/base/resource.h"
#include "common/kdtree/trace/triangle_test.h"
#include "preprocess/partition/region_pipeline.h"
#include "preprocess/partition/split.h"
#include "preprocess/partition/voxel_builder.h"
#include "preprocess/smooth/smooth_region.h"
#include "preprocess/texture/emission_means.h"

namespace quarry {
namespace {

// Memory of a triangle while its region is cut, beside its record: its vertices alone, references as a stack
// and one side of them, its voxel's copy and what that is encoded to. Smoothing takes less, before.
constexpr uint64_t kBytesOfCutting = 250;

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
  meta.up_axis = options.up_axis != 0                                  ? options.up_axis
                 : scene.up_evidence + options.up_habit.evidence() > 0 ? 1
                                                                       : 2;
  meta.input_triangles = scene.input_triangles;
  meta.dropped_degenerate = scene.dropped_degenerate;
  meta.dropped_not_finite = scene.dropped_not_finite;
  meta.voxel_size = options.voxel_size;
  return meta;
}

/// Steps from the root to the deepest leaf. Requires: children lie beyond their parents.
uint32_t DepthOf(const std::vector<KdNode>& nodes) {
  std::vector<uint32_t> depth(nodes.size());
  uint32_t deepest = 0;
  for (size_t i = 0; i < nodes.size(); ++i) {
    deepest = std::max(deepest, depth[i]);
    if (!nodes[i].is_leaf()) depth[nodes[i].left()] = depth[nodes[i].left() + 1] = depth[i] + 1;
  }
  return deepest;
}

/// The leaf in whose cell a point lies: one alone, where cells touch.
KdNode LeafAt(const std::vector<KdNode>& nodes, const glm::vec3& point) {
  KdNode node = nodes[0];
  while (!node.is_leaf()) node = nodes[node.left() + (point[node.axis()] < node.split() ? 0 : 1)];
  return node;
}

}  // namespace

BuildStage::BuildStage(const PreprocessOptions& options, WorkFolder& work, Progress& progress,
                       ImportedScene& scene)
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

Status BuildStage::Run() {
  const uint64_t triangles = scene_.triangles->count();
  const StageShares shares = StageShares::Of(triangles, scene_.images.size(), triangles <= kMostInMemory);
  if (triangles > kMostInMemory) {
    QUARRY_TRY(Restore());
    progress_.BeginStage(shares.dividing);
    QUARRY_TRY(Route());
    progress_.BeginStage(shares.smoothing);
    if (options_.crease > 0) QUARRY_TRY(SmoothBorders());
  } else {
    tree_ = {{KdNode{}}, {whole_}, {0}};
  }
  QUARRY_ASSIGN(StoreWriter writer,
                StoreWriter::Continue(options_.output, work_.store(), std::move(stored_)));
  writer_.emplace(std::move(writer));
  if (options_.crease > 0) writer_->AllowPackedNormals();
  for (const VoxelEntry& v : writer_->directory()) emitted_ += v.triangles;
  progress_.BeginStage(0);
  QUARRY_TRY(ReadCutOuts());
  progress_.BeginStage(shares.building);
  QUARRY_TRY(BuildVoxels());
  progress_.BeginStage(shares.images);
  if (files_ && !scene_.images.empty()) QUARRY_TRY(SaveBuilt(true));
  return textures_.Run(*writer_, progress_, [&](const Bytes& checkpoint) {
    return work_.kept() ? work_.Add(CheckpointKind::kTextures, checkpoint) : Status{};
  });
}

/// Reads the opacity of triangles from textures, if a region is still to be built.
Status BuildStage::ReadCutOuts() {
  const std::string path = work_.spill_folder() + "/cut-outs";
  std::error_code none;
  std::filesystem::remove(path, none);  // a run that was killed may have left it
  if (subtrees_.size() == tree_.regions.size() || scene_.images.empty()) return {};
  QUARRY_ASSIGN(cut_outs_,
                CutOuts::Read(scene_.materials, scene_.images, ImageDecodingOf(options_), path, progress_));
  partition_.masks = cut_outs_.any();
  return {};
}

/// Builds the regions that the journal does not have.
Status BuildStage::BuildVoxels() {
  const std::vector<uint64_t> counts =
      files_ ? files_->counts() : std::vector<uint64_t>{scene_.triangles->count()};
  const size_t first = subtrees_.size();
  // Progress counts triangles read: triangles built include copies.
  const uint64_t all = std::accumulate(counts.begin(), counts.end(), uint64_t{0});
  uint64_t before =
      std::accumulate(counts.begin(), counts.begin() + static_cast<ptrdiff_t>(first), uint64_t{0});
  const ShadingOptions shading{scene_.attributes != Attributes::kNone, options_.crease > 0};
  progress_.Begin(fmt::format("building voxels of {} triangles", scene_.triangles->count()), "triangles",
                  before);
  const TriangleMasks masks{[&](uint32_t material) { return cut_outs_.IsMapped(material); },
                            [&](const TriangleRecord& t) { return cut_outs_.PlaceOf(t); },
                            [&](const MaskPlace& place, bool fine) { return cut_outs_.MaskAt(place, fine); }};
  uint64_t delivered = 0;  // triangles of the region that is delivered now
  RegionWork work;
  work.cut = [&](size_t region, const std::function<Status(VoxelTask)>& emit) {
    PartitionOptions inner = partition_;
    inner.spill_prefix += fmt::format("{}-", region);
    return PartitionRegion(region, inner, emit, dropped_[region]);
  };
  work.build = [&](const VoxelTask& task) {
    EncodedVoxel voxel =
        BuildVoxel(task, meta_.padding, shading, options_.voxel_size, cut_outs_.any() ? &masks : nullptr);
    voxel.chained = task.chained;
    return voxel;
  };
  work.deliver = [&](const EncodedVoxel& voxel) {
    delivered += voxel.triangles;
    progress_.Update(before + std::min(delivered, counts[subtrees_.size()]), all);
    return writer_->AddVoxel(voxel);
  };
  work.finish = [&](size_t region, TopSubtree subtree) {
    emitted_ += std::exchange(delivered, 0);
    before += counts[region];
    subtrees_.push_back(std::move(subtree));
    return files_ ? SaveBuilt() : Status{};
  };
  dropped_.resize(counts.size());
  saved_at_ = Clock::now();
  const uint64_t of_triangle = RecordBytes(scene_.attributes) + kBytesOfCutting;
  QUARRY_TRY(BuildRegions(work, counts, first,
                          {.threads = options_.threads, .triangles = options_.memory / 4 * 3 / of_triangle}));
  progress_.End();
  if (cut_outs_.failed()) return Fail(fmt::format("{}: cannot be read", work_.spill_folder() + "/cut-outs"));
  if (writer_->voxel_count() > 0) return {};
  return Fail(fmt::format("{}: no triangle is left: opacity textures cut all {} out", options_.output,
                          meta_.input_triangles));
}

/// `dropped`: receives the transparent triangles of the region. Of a triangle in several regions, the one
/// that has its first vertex counts it.
Result<TopSubtree> BuildStage::PartitionRegion(size_t region, const PartitionOptions& options,
                                               const std::function<Status(VoxelTask)>& emit,
                                               uint64_t& dropped) const {
  const SpillFile& file = files_ ? files_->file(region) : *scene_.triangles;
  const Box content = files_ ? files_->contents()[region] : whole_.cell;
  const SpillFile* const border = borders_ ? &borders_->files()[region] : nullptr;
  std::function<bool(const TriangleRecord&)> drop;
  if (cut_outs_.any())
    drop = [&](const TriangleRecord& t) {
      if (!cut_outs_.IsTransparent(t)) return false;
      if (!files_ || LeafAt(tree_.nodes, t.vertices[0]).first() == region) ++dropped;
      return true;
    };
  return PartitionSmoothed(file, tree_.regions[region], content, options, border, options_.crease, emit,
                           drop);
}

Status BuildStage::Finish(PreprocessStatistics& statistics) {
  std::vector<KdNode> top = tree_.nodes;
  uint32_t voxels = 0;
  for (size_t i = 0; i < subtrees_.size(); ++i) {
    Graft(subtrees_[i], tree_.leaves[i], voxels, top);
    voxels += subtrees_[i].voxels;
  }
  statistics.voxels = writer_->voxel_count();
  statistics.stored_references = emitted_;
  statistics.up_evidence = scene_.up_evidence;
  statistics.top_tree_nodes = static_cast<uint32_t>(top.size());
  statistics.top_tree_depth = DepthOf(top);
  SceneMeta meta = meta_;
  meta.dropped_transparent = std::accumulate(dropped_.begin(), dropped_.end(), uint64_t{0});
  statistics.meta = meta;
  statistics.meta.masks = writer_->has_masks();
  statistics.meta.uncolored = !writer_->has_colors();
  statistics.textures = textures_.Statistics(*writer_);
  statistics.warnings += statistics.textures.left_out;
  textures_.Renumber(scene_.materials, *writer_);
  QUARRY_TRY(GiveEmitters(std::move(scene_.emitters), scene_.materials, work_.store(), *writer_));
  QUARRY_ASSIGN(statistics.scene_id, writer_->Finish(meta, top, scene_.materials, scene_.parts, scene_.views,
                                                     ModelNamesOf(options_)));
  statistics.store_bytes = writer_->bytes_written();
  return {};
}

/// Takes over the work that an earlier run's journal records.
Status BuildStage::Restore() {
  for (const SavedCheckpoint& checkpoint : work_.checkpoints()) QUARRY_TRY(RestoreRecord(checkpoint));
  if (!stored_.directory.empty()) {
    const BlockEntry& hot = stored_.directory.back().blocks[0];
    stored_.bytes = hot.offset + hot.stored + stored_.directory.back().blocks[1].stored;
  }
  for (const WrittenTexture& t : stored_.textures)
    for (const BlockEntry& page : t.texture.pages)
      stored_.bytes = std::max(stored_.bytes, page.offset + page.stored);
  saved_regions_ = subtrees_.size();
  saved_voxels_ = static_cast<uint32_t>(stored_.directory.size());
  saved_part_bytes_ = stored_.parts.bytes.size();
  return {};
}

Status BuildStage::RestoreRecord(const SavedCheckpoint& checkpoint) {
  ByteReader in(checkpoint.bytes);
  bool readable = true;
  switch (checkpoint.kind) {
    case CheckpointKind::kRegions: {
      const auto nodes = in.Get<uint32_t>(), regions = in.Get<uint32_t>();
      tree_ = {in.GetArray<KdNode>(nodes), in.GetArray<Region>(regions), in.GetArray<uint32_t>(regions)};
      readable = in.done();
      break;
    }
    case CheckpointKind::kRouted:
      routed_ = in.Get<uint64_t>();
      counts_ = in.GetArray<uint64_t>(tree_.regions.size());
      contents_ = in.GetArray<Box>(tree_.regions.size());
      readable = in.done();
      break;
    case CheckpointKind::kSmoothed:
      smoothed_ = in.Get<uint32_t>();
      border_counts_ = in.GetArray<uint64_t>(tree_.regions.size());
      readable = in.done() && smoothed_ <= tree_.regions.size();
      break;
    case CheckpointKind::kBuilt: {
      TopSubtree subtree;
      subtree.voxels = in.Get<uint32_t>();
      subtree.nodes = in.GetArray<KdNode>(in.Get<uint32_t>());
      for (const VoxelEntry& v : in.GetArray<VoxelEntry>(subtree.voxels)) stored_.directory.push_back(v);
      for (const uint64_t v : in.GetArray<uint64_t>(2 * subtree.voxels)) stored_.logical.push_back(v);
      for (const uint32_t v : in.GetArray<uint32_t>(subtree.voxels)) stored_.parts.sizes.push_back(v);
      for (const std::byte v : in.GetArray<std::byte>(in.Get<uint64_t>())) stored_.parts.bytes.push_back(v);
      subtrees_.push_back(std::move(subtree));
      dropped_.push_back(in.Get<uint64_t>());
      stored_.masks |= in.Get<uint8_t>() != 0;
      stored_.colored |= in.Get<uint8_t>() != 0;
      readable = in.done();
      break;
    }
    case CheckpointKind::kTextures:
      readable = textures_.Restore(checkpoint.bytes, stored_.textures).has_value();
      break;
    case CheckpointKind::kImported:
      break;
  }
  if (readable) return {};
  return CannotResume(fmt::format("{}: its journal cannot be read", work_.path()));
}

Status BuildStage::ChooseTree() {
  const uint64_t weight = scene_.sample.weight();
  tree_ = ChooseRegions(scene_.sample.TakeTriangles(), weight, meta_.padding, whole_);
  ByteWriter checkpoint;
  checkpoint.Put(static_cast<uint32_t>(tree_.nodes.size()));
  checkpoint.Put(static_cast<uint32_t>(tree_.regions.size()));
  checkpoint.PutArray(tree_.nodes);
  checkpoint.PutArray(tree_.regions);
  checkpoint.PutArray(tree_.leaves);
  return work_.Add(CheckpointKind::kRegions, checkpoint.Take());
}

/// Routes all triangles to the files of their regions. The import's file shrinks meanwhile.
Status BuildStage::Route() {
  if (tree_.regions.empty()) QUARRY_TRY(ChooseTree());
  QUARRY_ASSIGN(files_, RegionFiles::Open(tree_, partition_.spill_prefix, RecordBytes(scene_.attributes),
                                          partition_.memory, saved_regions_, counts_, contents_));
  const uint64_t triangles = scene_.triangles->count();
  // A kill may have come between a checkpoint and the Discard() after it.
  if (routed_ > 0 && routed_ < triangles) scene_.triangles->Discard(0, routed_);
  progress_.Begin("dividing triangles", "triangles", routed_);
  while (routed_ < triangles) {
    const uint64_t end = std::min(routed_ + kRoutedPerCheckpoint, triangles);
    QUARRY_TRY(files_->Add(*scene_.triangles, routed_, end, meta_.padding,
                           [&](uint64_t done) { progress_.Update(done, triangles); }));
    QUARRY_TRY(files_->WriteOut());
    ByteWriter checkpoint;
    checkpoint.Put(end);
    checkpoint.PutArray(files_->counts());
    checkpoint.PutArray(files_->contents());
    QUARRY_TRY(work_.Add(CheckpointKind::kRouted, checkpoint.Take()));
    scene_.triangles->Discard(routed_, end);
    routed_ = end;
  }
  progress_.End();
  scene_.triangles->Remove();
  CutOffEmptySpace(files_->contents(), whole_.cell, tree_);
  if (DepthOf(tree_.nodes) >= kMostLevels)
    return Fail(fmt::format("{}: its parts are nested too deep for a tree of {} levels", options_.output,
                            kMostLevels));
  return files_->FinishWriting();
}

/// Finds the smooth normals that regions must exchange, while all their files are there.
Status BuildStage::SmoothBorders() {
  const auto regions = static_cast<uint32_t>(tree_.regions.size());
  QUARRY_ASSIGN(
      borders_,
      BorderNormals::Open(tree_, work_.spill_folder() + "/border-", meta_.padding, options_.crease,
                          {.memory = partition_.memory, .gone = saved_regions_, .counts = border_counts_}));
  uint64_t all = 0, done = 0;
  for (uint32_t i = 0; i < regions; ++i) {
    all += files_->file(i).count();
    if (i < smoothed_) done = all;
  }
  const auto threads = static_cast<unsigned>(
      std::clamp<uint64_t>(options_.memory / BorderNormals::kThreadBytes, 1, options_.threads));
  if (smoothed_ < regions) progress_.Begin("smoothing the borders of regions", "triangles", done);
  while (smoothed_ < regions) {
    uint32_t end = smoothed_;
    for (uint64_t taken = 0; end < regions && taken < kRoutedPerCheckpoint; ++end)
      taken += files_->file(end).count();
    QUARRY_TRY(borders_->AddRegions(*files_, smoothed_, end, threads,
                                    [&](uint64_t triangles) { progress_.Update(done += triangles, all); }));
    smoothed_ = end;
    QUARRY_TRY(borders_->files().WriteOut());
    ByteWriter checkpoint;
    checkpoint.Put(smoothed_);
    checkpoint.PutArray(borders_->files().counts());
    QUARRY_TRY(work_.Add(CheckpointKind::kSmoothed, checkpoint.Take()));
    if (smoothed_ == regions) progress_.End();
  }
  return borders_->files().FinishWriting();
}

/// Records the regions whose voxels have all been written, once enough time has passed to be worth waiting
/// for the disk, or `now`; then deletes their files.
Status BuildStage::SaveBuilt(bool now) {
  if (saved_regions_ == subtrees_.size() || (!now && SecondsSince(saved_at_) < options_.checkpoint_seconds))
    return {};
  if (saved_voxels_ + subtrees_[saved_regions_].voxels > writer_->voxel_count()) return {};
  QUARRY_TRY(writer_->Flush());
  std::vector<Bytes> checkpoints;
  const size_t first = saved_regions_;
  while (saved_regions_ < subtrees_.size() &&
         saved_voxels_ + subtrees_[saved_regions_].voxels <= writer_->voxel_count()) {
    const TopSubtree& subtree = subtrees_[saved_regions_];
    ByteWriter checkpoint;
    checkpoint.Put(subtree.voxels);
    checkpoint.Put(static_cast<uint32_t>(subtree.nodes.size()));
    checkpoint.PutArray(subtree.nodes);
    checkpoint.PutArray(std::span(writer_->directory()).subspan(saved_voxels_, subtree.voxels));
    checkpoint.PutArray(std::span(writer_->logical()).subspan(2 * saved_voxels_, 2 * subtree.voxels));
    const std::span sizes = std::span(writer_->parts().sizes).subspan(saved_voxels_, subtree.voxels);
    const uint64_t bytes = std::accumulate(sizes.begin(), sizes.end(), uint64_t{0});
    checkpoint.PutArray(sizes);
    checkpoint.Put(bytes);
    checkpoint.PutArray(std::span(writer_->parts().bytes).subspan(saved_part_bytes_, bytes));
    saved_part_bytes_ += bytes;
    checkpoint.Put(dropped_[saved_regions_]);
    // Later regions are built again, with their masks and colours.
    checkpoint.Put<uint8_t>(writer_->has_masks());
    checkpoint.Put<uint8_t>(writer_->has_colors());
    checkpoints.push_back(checkpoint.Take());
    saved_voxels_ += subtree.voxels;
    ++saved_regions_;
  }
  QUARRY_TRY(work_.Add(CheckpointKind::kBuilt, checkpoints));
  for (size_t region = first; region < saved_regions_; ++region) {
    files_->file(region).Remove();
    if (borders_) borders_->files()[region].Remove();
  }
  saved_at_ = Clock::now();
  return {};
}

}  // namespace quarry
