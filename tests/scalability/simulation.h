#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "common/engine/adaptive_queue_depth.h"
#include "common/voxel/catalog.h"
#include "master/schedule/dispatcher.h"
#include "tests/scalability/simulated_time.h"
#include "tests/scalability/traced_walk.h"
#include "worker/sources/source_policy.h"
#include "worker/sources/stored_cache.h"

namespace quarry {

/// The options of `quarry bench simulate`. Units: links in Mbit/s, times in seconds unless a name has another
/// unit.
struct SimulatedCluster {
  unsigned servers = 1;
  bool peers = false, warm = false, planning = false;
  std::string policy = "footprint", cache = "64M";
  double worker_mbit = 100, server_mbit = 1000, share = 1, decode_gb_s = 0.6, latency_s = 4e-4, tile_us = 60,
         overhead_us = 0;
  unsigned waves = 6;
  std::string loading = "suspend";
};

/// The behaviour of a worker while a voxel is under way.
enum class Loading {
  kSuspend,  ///< traces other rays, as Quarry does
  kWait,     ///< waits for each voxel
  kMap       ///< waits for pieces of a mapped file of decoded voxels
};
/// Parses "suspend", "wait" or "map". Errors (usage): other text.
Result<Loading> ParseLoading(const std::string& text);

/// The finished probes of a walk, one per frame; empty when frames are not probed.
using Foreseen = std::vector<std::shared_ptr<const ProbedFrame>>;

/// A cluster that renders a walk in simulated time. The master's dispatcher, the choice of sources and the
/// cache of stored blocks are the real classes. The model covers a worker's processor (one tile or block at a
/// time), links (one block at a time), and the waves in which the rays of a tile come to its blocks.
/// Units: as SimulatedCluster. Not thread-safe.
class Simulation final : private FrameSource {
 public:
  /// `block_bytes`: stored bytes, by block number. Requires: all references outlive the simulation; the texts
  /// in `cluster` parse (ParsePolicy(), ParseLoading(), ParseSize()).
  Simulation(const SimulatedCluster& cluster, const TracedWalk& walk, const Foreseen& foreseen,
             const Catalog& catalog, const std::vector<uint32_t>& block_bytes, unsigned workers);

  /// Renders the walk. Returns: its seconds. With `warm`, renders it twice and returns the seconds of the
  /// second.
  double Run();

  uint64_t bytes() const { return bytes_; }            ///< received by workers
  uint64_t peer_bytes() const { return peer_bytes_; }  ///< of bytes(), from other workers
  /// Share of the touched bytes that were expected.
  double foreseen() const;
  /// Share of the bytes to fetch ahead that their worker then touched.
  double fulfilled() const;
  /// Real seconds per frame that the dispatcher took on this machine.
  double planning_s() const;
  /// The longest busy time of any worker's processor or link; no schedule of the same loads is faster.
  double least_s() const;
  double compute_s() const;      ///< busy time of all workers' processors together
  double server_busy_s() const;  ///< busy time of the busiest server's link

 private:
  struct Tile {
    TileOrder order;
    const TracedWalk::Tile* traced;
    std::vector<uint32_t> blocks;  ///< in the order in which rays come to them
    size_t wave_end = 0, left_in_wave = 0;
    double slice_s = 0;
  };
  using TilePtr = std::shared_ptr<Tile>;
  struct Worker : WorkerState {
    Worker(uint32_t number, uint64_t stored_bytes, uint64_t decoded_bytes, size_t sources)
        : stored(stored_bytes), decoded(decoded_bytes), answers(sources) {
      id = number;
      ready = true;
    }
    LruIndex stored, decoded;
    Serial processor, down, up;
    std::vector<AnswerTime> answers;  ///< of servers, then workers
    AnswerTime peer_answers;          ///< of all workers
    std::deque<TilePtr> queue, open;
    std::map<uint32_t, std::vector<TilePtr>> waiting;  ///< by block
    std::deque<uint32_t> wanted;
    std::set<uint32_t> hinted, touched;
    unsigned in_flight = 0;
    AdaptiveQueueDepth window{1};
    size_t slices = 0;  ///< slices left to compute; 0 while all rays wait
  };

  // FrameSource: the walk's frames; probes are finished when their frame begins.
  bool HasNext() const override { return next_frame_ < walk_.views.size(); }
  std::optional<View> Begin(FrameId id, double now_s) override;
  void Probe(std::span<ActiveFrame* const> frames) override;
  bool IsNextBeingProbed() const override { return false; }
  void Finish(ActiveFrame&, double now_s) override { last_done_s_ = now_s; }

  // The master.
  template <class Call>
  auto Timed(Call call);
  void AssignTiles();
  void Compare(Worker& w, const Tile& tile);
  void OnTileDone(Worker& w, const Tile& tile);

  // A worker.
  double ComputeTime(const Tile& tile) const {
    return (tile.traced->compute_s + o_.overhead_us * 1e-6) / o_.share;
  }
  void OpenTiles(Worker& w);
  void NextWave(Worker& w, const TilePtr& tile);
  void Need(Worker& w, const TilePtr& tile, uint32_t block);
  void Slice(Worker& w, const TilePtr& tile);
  void Load(Worker& w);
  uint32_t SourceOf(const Worker& w, uint32_t block) const;
  void Fetch(Worker& w, uint32_t block);
  void Decode(Worker& w, uint32_t block);
  void ReportHoldings(Worker& w, const std::vector<BlockKey>& blocks);
  BlockKey Key(uint32_t number) const { return *catalog_.BlockOf(number); }

  const SimulatedCluster& o_;
  const TracedWalk& walk_;
  const Foreseen& foreseen_;
  const Catalog& catalog_;
  const std::vector<uint32_t>& block_bytes_;
  const Loading loading_;
  Dispatcher dispatcher_;
  double seconds_per_byte_;  ///< of fetching and decoding a stored byte
  Clock clock_;
  std::vector<std::unique_ptr<Worker>> workers_;
  std::deque<Serial> servers_;
  std::vector<uint64_t> keys_;  ///< of servers, for HomeOrder
  Serial master_;
  std::map<FrameId, size_t> index_;  ///< index in the walk
  size_t next_frame_ = 0;
  uint64_t bytes_ = 0, peer_bytes_ = 0;
  uint64_t touched_bytes_ = 0, foreseen_bytes_ = 0;
  double last_done_s_ = 0;
  double decoded_s_ = 0;   ///< decoding by all workers
  double planning_s_ = 0;  ///< real time, not simulated
};

}  // namespace quarry
