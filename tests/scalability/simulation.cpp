#include "tests/scalability/simulation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/engine/blocks/loader.h"
#include "common/engine/engine.h"
#include "common/math/random.h"

namespace quarry {
namespace {

/// Bytes of a mapped file that come at a time: the default read-ahead of NFS clients.
constexpr double kMappedPiece = 128 << 10;

double Share(uint64_t part, uint64_t of) {
  return static_cast<double>(part) / static_cast<double>(std::max<uint64_t>(1, of));
}

}  // namespace

Result<Loading> ParseLoading(const std::string& text) {
  if (text == "suspend") return Loading::kSuspend;
  if (text == "wait") return Loading::kWait;
  if (text == "map") return Loading::kMap;
  return BadUsage(fmt::format("--loading is suspend, wait or map, not '{}'", text));
}

Simulation::Simulation(const SimulatedCluster& cluster, const TracedWalk& walk, const Foreseen& foreseen,
                       const Catalog& catalog, const std::vector<uint32_t>& block_bytes, unsigned workers)
    : o_(cluster),
      walk_(walk),
      foreseen_(foreseen),
      catalog_(catalog),
      block_bytes_(block_bytes),
      loading_(*ParseLoading(cluster.loading)),
      dispatcher_(*this, block_bytes, *ParsePolicy(cluster.policy), 1) {
  const uint64_t decoded = catalog.DecodedBytes();
  uint64_t in_store = 0;
  for (const uint32_t bytes : block_bytes) in_store += bytes;
  seconds_per_byte_ = 8e-6 / o_.worker_mbit + static_cast<double>(decoded) / static_cast<double>(in_store) /
                                                  (o_.decode_gb_s * 1e9) / o_.share;
  const uint64_t cache = *ParseSize(o_.cache, "--cache");
  const uint64_t stored =
      loading_ == Loading::kMap ? 0 : StoredCache::ShareOf(cache, decoded, catalog.meta.largest_decoded);
  for (uint32_t w = 0; w < workers; ++w) {
    workers_.push_back(std::make_unique<Worker>(w + 1, stored, cache - stored, o_.servers + workers));
    dispatcher_.AddWorker(*workers_.back());
  }
  dispatcher_.SetCosts(seconds_per_byte_, 0);
  for (unsigned s = 0; s < o_.servers; ++s) {
    servers_.emplace_back();
    keys_.push_back(Mix64(s + 1));
  }
}

double Simulation::Run() {
  double start_s = 0;
  for (int pass = 0; pass <= (o_.warm ? 1 : 0); ++pass) {
    next_frame_ = 0;
    bytes_ = peer_bytes_ = 0;
    for (const auto& w : workers_) w->processor.busy_s = w->down.busy_s = 0;
    for (Serial& s : servers_) s.busy_s = 0;
    start_s = clock_.now_s();
    AssignTiles();
    clock_.Run();
  }
  return last_done_s_ - start_s;
}

// --- Figures

double Simulation::foreseen() const { return Share(foreseen_bytes_, touched_bytes_); }

double Simulation::fulfilled() const {
  uint64_t hinted = 0, fulfilled = 0;
  for (const auto& w : workers_)
    for (const uint32_t b : w->hinted) {
      hinted += block_bytes_[b];
      if (w->touched.contains(b)) fulfilled += block_bytes_[b];
    }
  return Share(fulfilled, hinted);
}

double Simulation::planning_s() const {
  return planning_s_ / static_cast<double>(walk_.views.size()) / (o_.warm ? 2 : 1);
}

double Simulation::least_s() const {
  double most = 0;
  for (const auto& w : workers_) most = std::max({most, w->processor.busy_s, w->down.busy_s});
  return most;
}

double Simulation::compute_s() const {
  double sum = 0;
  for (const auto& w : workers_) sum += w->processor.busy_s;
  return sum;
}

double Simulation::server_busy_s() const {
  double most = 0;
  for (const Serial& s : servers_) most = std::max(most, s.busy_s);
  return most;
}

// --- The master

std::optional<View> Simulation::Begin(FrameId id, double) {
  if (!HasNext()) return std::nullopt;
  index_[id] = next_frame_;
  return walk_.views[next_frame_++];
}

void Simulation::Probe(std::span<ActiveFrame* const> frames) {
  if (workers_.size() == 1 || foreseen_.empty()) return;
  for (ActiveFrame* frame : frames)
    if (!frame->learned()) frame->Learn(foreseen_[index_.at(frame->id())]);
}

/// With --planning, the simulated master is busy for the time that the dispatcher takes on this machine.
template <class Call>
auto Simulation::Timed(Call call) {
  const auto start = std::chrono::steady_clock::now();
  auto result = call();
  const double took_s = SecondsSince(start);
  planning_s_ += took_s;
  if (o_.planning) (void)master_.Take(clock_.now_s(), took_s);
  return result;
}

void Simulation::AssignTiles() {
  for (const auto& w : workers_) w->tiles_wanted = w->window.wanted();
  for (AssignedTile& assigned : Timed([this] { return dispatcher_.AssignTiles(clock_.now_s()); })) {
    Worker& w = *workers_[assigned.worker - 1];
    auto tile = std::make_shared<Tile>();
    tile->traced = &walk_.tiles[index_.at(assigned.frame->id())][assigned.order.tile];
    tile->order = std::move(assigned.order);
    w.hinted.insert(tile->order.blocks.begin(), tile->order.blocks.end());
    const double there_s = master_.Take(clock_.now_s(), o_.tile_us * 1e-6) + o_.latency_s / 2;
    clock_.At(there_s, [this, tile, &w] {
      w.queue.push_back(tile);
      OpenTiles(w);
    });
  }
}

/// Counts the share of the tile's footprint that was expected.
void Simulation::Compare(Worker& w, const Tile& tile) {
  const std::set<uint32_t> touched(tile.traced->blocks.begin(), tile.traced->blocks.end());
  for (const uint32_t b : touched) touched_bytes_ += block_bytes_[b];
  w.touched.insert(touched.begin(), touched.end());
  const TileFootprint& expected = dispatcher_.Find(tile.order.frame)->Expected(tile.order.tile);
  for (size_t i = 0; i < expected.blocks.size(); ++i)
    if (expected.chances[i] >= kLikely && touched.contains(expected.blocks[i]))
      foreseen_bytes_ += block_bytes_[expected.blocks[i]];
}

void Simulation::OnTileDone(Worker& w, const Tile& tile) {
  TileDone done{tile.order.frame, tile.order.tile, tile.order.lease};
  done.compute_us = static_cast<uint64_t>(tile.traced->compute_s * 1e6 / o_.share);
  done.depths = tile.traced->depths;
  done.blocks = tile.traced->blocks;
  if (dispatcher_.Find(done.frame)) Compare(w, tile);
  const Bytes pixels(size_t{tile.order.area.pixels.width} * tile.order.area.pixels.height * 4 * kColorWords);
  (void)Timed([&] { return dispatcher_.Finish(w, done, pixels, clock_.now_s()); });
  AssignTiles();
}

// --- A worker

void Simulation::OpenTiles(Worker& w) {
  const size_t most = loading_ == Loading::kSuspend ? Engine::kMostOpenTiles : 1;
  while (w.slices == 0 && w.open.size() < most && !w.queue.empty()) {
    auto tile = w.queue.front();
    w.queue.pop_front();
    w.open.push_back(tile);
    tile->blocks = tile->traced->blocks;
    // The trace does not tell the order of blocks: a pseudorandom order, the same in every run.
    std::sort(tile->blocks.begin(), tile->blocks.end(), [&](uint32_t a, uint32_t b) {
      return Mix64(a * 2654435761u + tile->order.tile) < Mix64(b * 2654435761u + tile->order.tile);
    });
    tile->slice_s = ComputeTime(*tile) / std::max<double>(1, static_cast<double>(tile->blocks.size()));
    NextWave(w, tile);
  }
  if (w.slices == 0 && !w.open.empty() && w.open.size() < most) w.window.Starved();
}

void Simulation::NextWave(Worker& w, const TilePtr& tile) {
  if (tile->wave_end == tile->blocks.size()) {
    const double s = tile->blocks.empty() ? ComputeTime(*tile) : 0;
    ++w.slices;
    clock_.At(w.processor.Take(clock_.now_s(), s), [this, &w, tile] {
      --w.slices;
      std::erase(w.open, tile);
      w.window.Finished();
      const double there_s = master_.Take(clock_.now_s() + o_.latency_s / 2, o_.tile_us * 1e-6);
      clock_.At(there_s, [this, &w, tile] { OnTileDone(w, *tile); });
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

void Simulation::Need(Worker& w, const TilePtr& tile, uint32_t block) {
  if (w.decoded.Use(Key(block))) return Slice(w, tile);
  auto& waiting = w.waiting[block];
  waiting.push_back(tile);
  if (waiting.size() > 1) return;
  w.wanted.push_back(block);
  Load(w);
}

/// A slice of a tile: the rays that go through one block.
void Simulation::Slice(Worker& w, const TilePtr& tile) {
  ++w.slices;
  clock_.At(w.processor.Take(clock_.now_s(), tile->slice_s), [this, &w, tile] {
    --w.slices;
    if (--tile->left_in_wave == 0) NextWave(w, tile);
    OpenTiles(w);
  });
}

void Simulation::Load(Worker& w) {
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

/// The number of a source: servers first, then workers.
uint32_t Simulation::SourceOf(const Worker& w, uint32_t block) const {
  std::vector<uint32_t> order = HomeOrder(block, keys_);
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
  return static_cast<uint32_t>(ChooseSource(order, views));
}

void Simulation::Fetch(Worker& w, uint32_t block) {
  const uint32_t source = SourceOf(w, block);
  const bool peer = source >= o_.servers;
  const double decoded = catalog_.block(Key(block)).decoded, asked_s = clock_.now_s();
  const double bytes = loading_ == Loading::kMap ? decoded : block_bytes_[block] + 24.0;
  const double pieces = loading_ == Loading::kMap ? std::ceil(decoded / kMappedPiece) : 1;
  Serial& up = peer ? workers_[source - o_.servers]->up : servers_[source];
  const double up_mbit = peer ? o_.worker_mbit : o_.server_mbit;
  const double sent_s = up.Take(asked_s + o_.latency_s / 2, bytes * 8e-6 / up_mbit);
  // The slower of two links in a row decides; blocks that a link queued earlier come first.
  const double come_s =
      std::max(sent_s, w.down.Take(sent_s - bytes * 8e-6 / up_mbit, bytes * 8e-6 / o_.worker_mbit)) +
      o_.latency_s * (pieces - 0.5);
  const auto came = loading_ == Loading::kMap ? static_cast<uint64_t>(decoded) : block_bytes_[block];
  bytes_ += came;
  if (peer) peer_bytes_ += came;
  clock_.At(come_s, [this, &w, block, source, peer, asked_s] {
    w.answers[source].Add(clock_.now_s() - asked_s);
    if (peer) w.peer_answers.Add(clock_.now_s() - asked_s);
    std::vector<BlockKey> gone;
    w.stored.Insert(Key(block), block_bytes_[block], false, gone);
    ReportHoldings(w, gone);
    Decode(w, block);
  });
}

void Simulation::Decode(Worker& w, uint32_t block) {
  const uint32_t decoded = catalog_.block(Key(block)).decoded;
  const double decode_s = loading_ == Loading::kMap ? 0 : decoded / (o_.decode_gb_s * 1e9) / o_.share;
  dispatcher_.SetCosts(seconds_per_byte_, decoded_s_ += decode_s);
  clock_.At(w.processor.Take(clock_.now_s(), decode_s), [this, &w, block, decoded] {
    std::vector<BlockKey> gone;
    w.decoded.Insert(Key(block), decoded, false, gone);
    gone.push_back(Key(block));
    ReportHoldings(w, gone);
    --w.in_flight;
    for (const auto& tile : std::exchange(w.waiting[block], {})) Slice(w, tile);
    w.waiting.erase(block);
    Load(w);
  });
}

/// Reports to the dispatcher whether the worker holds these blocks.
void Simulation::ReportHoldings(Worker& w, const std::vector<BlockKey>& blocks) {
  for (const BlockKey b : blocks) w.holds.Set(catalog_.NumberOf(b), w.stored.Has(b) || w.decoded.Has(b));
}

}  // namespace quarry
