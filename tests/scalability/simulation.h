#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/engine/blocks/loader.h"
#include "common/engine/engine.h"
#include "common/math/random.h"
#include "common/voxel/catalog.h"
#include "master/schedule/active_frame.h"
#include "master/schedule/unattributed_tile_cost.h"
#include "tests/scalability/simulated_time.h"
#include "tests/scalability/traced_walk.h"
#include "worker/sources/source_policy.h"
#include "worker/sources/stored_cache.h"

// A cluster in simulated time: the real scheduler (Predict, Plan, Schedule, AssignTiles), the real choice of
// sources and the real cache of stored blocks, on a walk that was traced once (quarry-master --trace). What
// is modelled is the rest: a worker's processor computes tiles and decodes blocks one thing at a time; a tile
// needs its blocks in waves, as rays come to them; blocks go over links that are busy with one at a time.

namespace quarry {

/// Links in Mbit/s, times in seconds unless they say otherwise: the options of `quarry bench simulate`.
struct SimulatedCluster {
  unsigned servers = 1;
  bool peers = false, warm = false, planning = false;
  std::string policy = "footprint", cache = "64M";
  double worker_mbit = 100, server_mbit = 1000, share = 1, decode_gb_s = 0.6, latency_s = 4e-4, tile_us = 60,
         overhead_us = 0;
  unsigned waves = 6;
  std::string loading = "suspend";
};

/// What a worker does while a voxel comes.
enum class Loading {
  kSuspend,  ///< goes on with other rays; as Quarry does
  kWait,     ///< nothing: one tile, one voxel after the other
  kMap       ///< nothing, and the voxel is decoded bytes of a file mapped over the network, piece by piece
};
/// Of a mapped file, as NFS clients read ahead by default.
inline constexpr double kMappedPiece = 128 << 10;

inline Result<Loading> ParseLoading(const std::string& text) {
  if (text == "suspend") return Loading::kSuspend;
  if (text == "wait") return Loading::kWait;
  if (text == "map") return Loading::kMap;
  return BadUsage(fmt::format("--loading is suspend, wait or map, not '{}'", text));
}

/// Of each frame what coarse rays come to; it is there when the frame begins. Empty: none are sent.
using Foreseen = std::vector<std::shared_ptr<const CoarseFrame>>;

/// The walk rendered by so many workers. What it is made of must outlive it; the cluster's texts have been
/// checked (ParsePolicy, ParseLoading, ParseSize).
class Simulation {
 public:
  Simulation(const SimulatedCluster& o, const TracedWalk& walk, const Foreseen& foreseen,
             const Catalog& catalog, const std::vector<uint32_t>& block_bytes, unsigned workers)
      : o_(o),
        walk_(walk),
        foreseen_(foreseen),
        catalog_(catalog),
        block_bytes_(block_bytes),
        policy_(*ParsePolicy(o.policy)),
        loading_(*ParseLoading(o.loading)) {
    uint64_t decoded = 0, in_store = 0;
    for (const VoxelEntry& v : catalog.voxels) decoded += v.blocks[0].decoded + v.blocks[1].decoded;
    for (const uint32_t bytes : block_bytes) in_store += bytes;
    seconds_per_byte_ = 8e-6 / o.worker_mbit + static_cast<double>(decoded) / static_cast<double>(in_store) /
                                                   (o.decode_gb_s * 1e9) / o.share;
    const uint64_t cache = *ParseSize(o.cache, "--cache");
    const uint64_t stored =
        loading_ == Loading::kMap ? 0 : StoredCache::ShareOf(cache, decoded, catalog.meta.largest_decoded);
    for (uint32_t w = 0; w < workers; ++w)
      workers_.push_back(std::make_unique<Worker>(w + 1, stored, cache - stored, o.servers + workers));
    for (unsigned s = 0; s < o.servers; ++s) {
      servers_.emplace_back();
      keys_.push_back(Mix64(s + 1));
    }
  }

  /// Seconds of the walk. With `warm`, of a second one after it.
  double Run() {
    double start_s = 0;
    for (int pass = 0; pass <= (o_.warm ? 1 : 0); ++pass) {
      next_frame_ = 0;
      bytes_ = peer_bytes_ = 0;
      for (const auto& w : workers_) w->processor.busy_s = w->down.busy_s = 0;
      for (Serial& s : servers_) s.busy_s = 0;
      start_s = clock_.now_s();
      HandOutTiles();
      clock_.Run();
    }
    return last_done_s_ - start_s;
  }
  uint64_t bytes() const { return bytes_; }
  uint64_t peer_bytes() const { return peer_bytes_; }
  /// Of the bytes that tiles touched, those that were expected; and of those that workers were told to fetch
  /// ahead, those touched.
  double foreseen() const { return double(foreseen_bytes_) / double(std::max<uint64_t>(1, touched_bytes_)); }
  double fulfilled() const {
    uint64_t hinted = 0, fulfilled = 0;
    for (const auto& w : workers_)
      for (const uint32_t b : w->hinted) {
        hinted += block_bytes_[b];
        if (w->touched.contains(b)) fulfilled += block_bytes_[b];
      }
    return static_cast<double>(fulfilled) / static_cast<double>(std::max<uint64_t>(1, hinted));
  }
  /// Real seconds of this machine that foreseeing and planning took, a frame.
  double planning_s() const {
    return planning_s_ / static_cast<double>(walk_.jobs.size()) / (o_.warm ? 2 : 1);
  }
  /// What a worker needs at least, of its processor or its link, the most of any.
  double least_s() const {
    double most = 0;
    for (const auto& w : workers_) most = std::max({most, w->processor.busy_s, w->down.busy_s});
    return most;
  }
  double compute_s() const {
    double sum = 0;
    for (const auto& w : workers_) sum += w->processor.busy_s;
    return sum;
  }
  double server_busy_s() const {
    double most = 0;
    for (const Serial& s : servers_) most = std::max(most, s.busy_s);
    return most;
  }

 private:
  struct Tile {
    ActiveFrame* frame;
    TileOrder order;
    const TracedWalk::Tile* traced;
    std::vector<uint32_t> blocks;  ///< in the order in which its rays come to them
    size_t wave_end = 0, left_in_wave = 0;
    double slice_s = 0;
  };
  struct Worker {
    Worker(uint32_t number, uint64_t stored_bytes, uint64_t decoded_bytes, size_t sources)
        : id(number), stored(stored_bytes), decoded(decoded_bytes), answers(sources) {}
    uint32_t id;
    LruIndex stored, decoded;
    Serial processor, down, up;
    BlockSet holds;
    std::vector<AnswerTime> answers;  ///< of servers, then workers
    AnswerTime peer_answers;          ///< of all workers
    std::deque<std::shared_ptr<Tile>> queue, open;
    std::map<uint32_t, std::vector<std::shared_ptr<Tile>>> waiting;
    std::deque<uint32_t> wanted;
    std::set<uint32_t> hinted, touched;
    unsigned in_flight = 0;
    AdaptiveQueueDepth window{1};
    size_t slices = 0;  ///< that its processor has still to compute: none while all rays wait
  };
  // --- the master

  ActiveFrame* StartFrame() {
    if (!MayBegin(Frames()) || next_frame_ == walk_.jobs.size()) return nullptr;
    const ActiveFrame* before = frames_.empty() ? previous_.get() : frames_.back().get();
    frames_.push_back(std::make_unique<ActiveFrame>(next_setup_++, walk_.jobs[next_frame_], before));
    if (workers_.size() > 1 && !foreseen_.empty()) frames_.back()->Learn(foreseen_[next_frame_]);
    index_[frames_.back().get()] = next_frame_++;
    MakePlans();
    return frames_.back().get();
  }

  std::vector<ActiveFrame*> Frames() const {
    std::vector<ActiveFrame*> frames;
    for (const auto& f : frames_) frames.push_back(f.get());
    return frames;
  }

  void MakePlans() {
    std::map<uint32_t, double> speeds;
    std::map<uint32_t, BlockSet> holds;
    for (const auto& w : workers_) {
      speeds[w->id] = 1;
      holds[w->id] = w->holds;
    }
    const auto start = std::chrono::steady_clock::now();
    PlanFrames(Frames(), previous_.get(), PlanNews::kFrames, speeds, std::move(holds),
               {block_bytes_, seconds_per_byte_, overhead_.seconds()}, policy_);
    const double took_s = SecondsSince(start);
    planning_s_ += took_s;
    if (o_.planning) (void)master_.Take(clock_.now_s(), took_s);
  }

  void HandOutTiles() {
    std::vector<WorkerCredit> hands;
    for (const auto& w : workers_) hands.push_back({w->id, w->window.wanted(), 1});
    const bool ending = next_frame_ == walk_.jobs.size();
    std::function<double(const ActiveFrame&, uint32_t, uint32_t)> fetch_s;
    if (policy_ == SchedulingPolicy::kFootprint)
      fetch_s = [this](const ActiveFrame& frame, uint32_t tile, uint32_t worker) {
        return ExpectedBytes(frame.Expected(tile), workers_[worker - 1]->holds, block_bytes_) *
               seconds_per_byte_;
      };
    for (AssignedTile& handed :
         AssignTiles(Frames(), hands, clock_.now_s(), ending, fetch_s, [this] { return StartFrame(); })) {
      auto tile = std::make_shared<Tile>();
      tile->frame = handed.frame;
      tile->order = handed.order;
      const TileTrace& expected = handed.frame->Expected(handed.order.tile);
      for (size_t i = 0; i < expected.blocks.size(); ++i)
        if (expected.chances[i] >= kHintChance && !workers_[handed.worker - 1]->holds.Has(expected.blocks[i]))
          workers_[handed.worker - 1]->hinted.insert(expected.blocks[i]);
      tile->traced = &walk_.tiles[index_.at(handed.frame)][handed.order.tile];
      const double there_s = master_.Take(clock_.now_s(), o_.tile_us * 1e-6) + o_.latency_s / 2;
      clock_.At(there_s, [this, tile, w = workers_[handed.worker - 1].get()] {
        w->queue.push_back(tile);
        OpenTiles(*w);
      });
    }
    std::unordered_map<uint32_t, uint32_t> held;
    for (const auto& frame : frames_) frame->AddHeld(held);
    overhead_.Busy(clock_.now_s(), static_cast<uint32_t>(held.size()));  // a thread each
  }

  /// How well it was known what the tile would touch.
  void Compare(Worker& w, const Tile& tile) {
    const std::set<uint32_t> touched(tile.traced->blocks.begin(), tile.traced->blocks.end());
    for (const uint32_t b : touched) touched_bytes_ += block_bytes_[b];
    w.touched.insert(touched.begin(), touched.end());
    const TileTrace& expected = tile.frame->Expected(tile.order.tile);
    for (size_t i = 0; i < expected.blocks.size(); ++i) {
      if (expected.chances[i] < kLeastChance) continue;
      const uint32_t b = expected.blocks[i];
      if (touched.contains(b)) foreseen_bytes_ += block_bytes_[b];
    }
  }

  void Finish(Worker& w, const std::shared_ptr<Tile>& tile) {
    TileDone done{tile->order.setup, tile->order.tile, tile->order.lease};
    done.compute_us = static_cast<uint64_t>(tile->traced->compute_s * 1e6 / o_.share);
    done.depths = tile->traced->depths;
    done.blocks = tile->traced->blocks;
    const auto it =
        std::find_if(frames_.begin(), frames_.end(), [&](const auto& f) { return f->setup() == done.setup; });
    if (it != frames_.end()) {
      Compare(w, *tile);
      const Bytes pixels(size_t{tile->order.width} * tile->order.height * 12);
      (void)(*it)->Finish(done, pixels, clock_.now_s());
      overhead_.Done(tile->traced->compute_s / o_.share);
      if ((*it)->done()) {
        overhead_.Fade();
        last_done_s_ = clock_.now_s();
        index_.erase(it->get());
        previous_ = std::move(*it);
        frames_.erase(it);
        if (!StartFrame()) MakePlans();
      }
    }
    HandOutTiles();
  }

  // --- a worker

  double ComputeTime(const Tile& tile) const {
    return (tile.traced->compute_s + o_.overhead_us * 1e-6) / o_.share;
  }

  void OpenTiles(Worker& w) {
    const size_t most = loading_ == Loading::kSuspend ? Engine::kMostOpenTiles : 1;
    while (w.slices == 0 && w.open.size() < most && !w.queue.empty()) {
      auto tile = w.queue.front();
      w.queue.pop_front();
      w.open.push_back(tile);
      tile->blocks = tile->traced->blocks;
      // Which block rays come to first is not traced: any order, the same every time.
      std::sort(tile->blocks.begin(), tile->blocks.end(), [&](uint32_t a, uint32_t b) {
        return Mix64(a * 2654435761u + tile->order.tile) < Mix64(b * 2654435761u + tile->order.tile);
      });
      tile->slice_s = ComputeTime(*tile) / std::max<double>(1, static_cast<double>(tile->blocks.size()));
      NextWave(w, tile);
    }
    if (w.slices == 0 && !w.open.empty() && w.open.size() < most) w.window.Starved();
  }

  void NextWave(Worker& w, const std::shared_ptr<Tile>& tile) {
    if (tile->wave_end == tile->blocks.size()) {
      const double s = tile->blocks.empty() ? ComputeTime(*tile) : 0;
      ++w.slices;
      clock_.At(w.processor.Take(clock_.now_s(), s), [this, &w, tile] {
        --w.slices;
        std::erase(w.open, tile);
        w.window.Finished();
        const double there_s = master_.Take(clock_.now_s() + o_.latency_s / 2, o_.tile_us * 1e-6);
        clock_.At(there_s, [this, &w, tile] { Finish(w, tile); });
        OpenTiles(w);
      });
      return;
    }
    const size_t begin = tile->wave_end, all = tile->blocks.size();
    tile->wave_end =
        loading_ == Loading::kSuspend ? std::min(all, begin + (all + o_.waves - 1) / o_.waves) : begin + 1;
    tile->left_in_wave = tile->wave_end - begin;
    for (size_t i = begin; i < tile->wave_end; ++i) Need(w, tile, tile->blocks[i]);
  }

  void Need(Worker& w, const std::shared_ptr<Tile>& tile, uint32_t block) {
    if (w.decoded.Use(Key(block))) return Slice(w, tile);
    auto& waiting = w.waiting[block];
    waiting.push_back(tile);
    if (waiting.size() > 1) return;
    w.wanted.push_back(block);
    Load(w);
  }

  /// A part of the tile's rays, those that go through one block.
  void Slice(Worker& w, const std::shared_ptr<Tile>& tile) {
    ++w.slices;
    clock_.At(w.processor.Take(clock_.now_s(), tile->slice_s), [this, &w, tile] {
      --w.slices;
      if (--tile->left_in_wave == 0) NextWave(w, tile);
      OpenTiles(w);
    });
  }

  void Load(Worker& w) {
    while (w.in_flight < Loader::kMaxInFlight && !w.wanted.empty()) {
      const uint32_t block = w.wanted.front();
      w.wanted.pop_front();
      ++w.in_flight;
      if (w.stored.Use(Key(block)))
        Decode(w, block);
      else
        Fetch(w, block);
    }
  }

  void Fetch(Worker& w, uint32_t block) {
    std::vector<uint32_t> order = HomeOrder(Key(block), keys_);
    if (o_.peers)
      for (const auto& other : workers_)
        if (other.get() != &w && other->stored.Has(Key(block))) {
          order.push_back(o_.servers + other->id - 1);
          break;
        }
    std::vector<SourceView> views(o_.servers + workers_.size(), {0, false});
    for (const uint32_t s : order) {
      const double known_s = w.answers[s].mean_s();
      views[s] = {known_s == 0 && s >= o_.servers ? w.peer_answers.mean_s() : known_s, true};
    }
    const auto source = static_cast<uint32_t>(ChooseSource(order, views));
    const bool peer = source >= o_.servers;
    const double decoded = catalog_.block(Key(block)).decoded, asked_s = clock_.now_s();
    const double bytes = loading_ == Loading::kMap ? decoded : block_bytes_[block] + 24.0;
    const double pieces = loading_ == Loading::kMap ? std::ceil(decoded / kMappedPiece) : 1;
    Serial& up = peer ? workers_[source - o_.servers]->up : servers_[source];
    const double up_mbit = peer ? o_.worker_mbit : o_.server_mbit;
    const double sent_s = up.Take(asked_s + o_.latency_s / 2, bytes * 8e-6 / up_mbit);
    // The slower of two links in a row decides; what is queued in each comes first.
    const double come_s =
        std::max(sent_s, w.down.Take(sent_s - bytes * 8e-6 / up_mbit, bytes * 8e-6 / o_.worker_mbit)) +
        o_.latency_s * (pieces - 0.5);
    const auto came = loading_ == Loading::kMap ? static_cast<uint64_t>(decoded) : block_bytes_[block];
    bytes_ += came;
    if (peer) peer_bytes_ += came;
    clock_.At(come_s, [this, &w, block, source, asked_s] {
      w.answers[source].Add(clock_.now_s() - asked_s);
      if (source >= o_.servers) w.peer_answers.Add(clock_.now_s() - asked_s);
      std::vector<BlockKey> gone;
      w.stored.Insert(Key(block), block_bytes_[block], false, gone);
      Told(w, gone);
      Decode(w, block);
    });
  }

  void Decode(Worker& w, uint32_t block) {
    const uint32_t decoded = catalog_.block(Key(block)).decoded;
    const double decode_s = loading_ == Loading::kMap ? 0 : decoded / (o_.decode_gb_s * 1e9) / o_.share;
    overhead_.Decoded(decoded_s_ += decode_s);
    clock_.At(w.processor.Take(clock_.now_s(), decode_s), [this, &w, block, decoded] {
      std::vector<BlockKey> gone;
      w.decoded.Insert(Key(block), decoded, false, gone);
      gone.push_back(Key(block));
      Told(w, gone);
      --w.in_flight;
      for (const auto& tile : std::exchange(w.waiting[block], {})) Slice(w, tile);
      w.waiting.erase(block);
      Load(w);
    });
  }

  /// What the master knows of these blocks.
  static void Told(Worker& w, const std::vector<BlockKey>& blocks) {
    for (const BlockKey b : blocks) w.holds.Set(b.number(), w.stored.Has(b) || w.decoded.Has(b));
  }
  static BlockKey Key(uint32_t number) { return BlockKey::FromNumber(number); }

  const SimulatedCluster& o_;
  const TracedWalk& walk_;
  const Foreseen& foreseen_;
  const Catalog& catalog_;
  const std::vector<uint32_t>& block_bytes_;
  const SchedulingPolicy policy_;
  const Loading loading_;
  double seconds_per_byte_;  ///< stored: fetching and decoding
  Clock clock_;
  std::vector<std::unique_ptr<Worker>> workers_;
  std::deque<Serial> servers_;
  std::vector<uint64_t> keys_;
  Serial master_;
  UnattributedTileCost overhead_;
  std::deque<std::unique_ptr<ActiveFrame>> frames_;
  std::unique_ptr<ActiveFrame> previous_;
  std::map<const ActiveFrame*, size_t> index_;
  size_t next_frame_ = 0;
  uint64_t next_setup_ = 1, bytes_ = 0, peer_bytes_ = 0;
  uint64_t touched_bytes_ = 0, foreseen_bytes_ = 0;
  double last_done_s_ = 0;
  double decoded_s_ = 0;   ///< by all workers
  double planning_s_ = 0;  ///< real time, not simulated
};

}  // namespace quarry
