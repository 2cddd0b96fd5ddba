// A master whose workers, clients and voxel fetchers follow the bytes, in any order and at any time. At the
// end all but the clients leave, an honest worker connects, and every client must get its frames or the
// reason why not.
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "master/server.h"
#include "tests/fuzz/memory_net.h"
#include "tests/fuzz/session_script.h"
#include "tests/support/temporary_folder.h"

namespace quarry::fuzz {
namespace {

/// Actions that an input's bytes choose; the seeds are written in them.
enum Action : uint8_t {
  kConnect,
  kHello,
  kJob,
  kAnswer,
  kAnswerAll,
  kWorkerStatus,
  kBlock,
  kFail,
  kAny,
  kBreak,
  kTime,
  kPause,
  kReads,
  kServesAt,
  kActions
};

/// The other side of a connection to the master.
struct Peer {
  MemoryConnectionPtr connection;
  std::map<uint64_t, uint32_t> words;  ///< of a pixel, by frame
  std::deque<TileOrder> orders;
  uint32_t frames_wanted = 0, frames = 0;
  bool told = false;  ///< of a failure

  bool Waits() const { return !connection->closed() && !told && frames < frames_wanted; }
};

class Cast {
 public:
  explicit Cast(Script& script) : script_(script) {}

  void Begin(boost::asio::io_context& io, std::function<MemoryConnectionPtr()> accept) {
    io_ = &io;
    accept_ = std::move(accept);
    Repeat(io, [this] {
      if (!script_.over()) return Act(), true;
      return AllServed() ? io_->stop(), false : true;
    });
  }

 private:
  Peer& Connect() {
    peers_.push_back(std::make_unique<Peer>());
    Peer& peer = *peers_.back();
    peer.connection = accept_();
    peer.connection->on_sent = [this, &peer](const Message& m) { OnSent(peer, m); };
    return peer;
  }

  void OnSent(Peer& peer, const Message& m) {
    if (m.type == MessageType::kFrameSetup)
      peer.words[DecodeFrameSetup(m.table)->frame] = WordsPerPixel(DecodeFrameSetup(m.table)->view.aov_mask);
    if (m.type == MessageType::kTile) peer.orders.push_back(*DecodeTileOrder(m.table));
    if (m.type == MessageType::kFailure) peer.told = true;
    if (m.type == MessageType::kFrameDone) ++peer.frames;
    if (&peer == honest_) AnswerAll(peer);
  }

  void Act() {
    const uint32_t action = script_.Below(kActions);
    if (action == kConnect) {
      if (peers_.size() < 12) Connect();
      return;
    }
    if (action == kTime) return PassTime(*io_, kTimes[script_.Below(std::size(kTimes))]);
    if (action == kPause)
      return std::this_thread::sleep_for(std::chrono::microseconds(200));  // for the encoder
    if (peers_.empty()) return;
    Peer& peer = *peers_[script_.Below(static_cast<uint32_t>(peers_.size()))];
    MemoryConnection& c = *peer.connection;
    switch (action) {
      case kHello:
        return c.Come(
            MakeMessage(MessageType::kHello,
                        Hello{static_cast<Role>(script_.Below(3)), script_.Text(), 1 + script_.Below(3),
                              script_.Below(4), static_cast<uint16_t>(script_.Below(3))}));
      case kJob: {
        RenderJob job = AnyJob(script_);
        const uint32_t have = script_.Below(3);
        // A job that the decoder refuses must be refused with a sentence.
        if (have <= job.cameras.size())
          peer.frames_wanted += static_cast<uint32_t>(job.cameras.size()) - have;
        return c.Come(MakeMessage(MessageType::kRenderJob, JobRequest{std::move(job), have}));
      }
      case kAnswer:
        return Answer(peer, script_.Below(7), script_.Byte());
      case kAnswerAll:
        return AnswerAll(peer);
      case kWorkerStatus: {
        WorkerStatus alive;
        alive.whole = script_.Below(2) == 0;
        for (uint32_t n = script_.Below(8); n > 0; --n) alive.cached.push_back(script_.Byte());
        for (uint32_t n = script_.Below(8); n > 0; --n) alive.dropped.push_back(script_.Byte());
        return c.Come(MakeMessage(MessageType::kWorkerStatus, alive));
      }
      case kBlock:
        return c.Come(
            MakeMessage(MessageType::kBlockRequest, BlockRequest{script_.Number()}, script_.Number()));
      case kFail:
        return c.Come(MakeMessage(MessageType::kFailure, Failure{script_.Text()}));
      case kAny: {
        Message m = AnyMessage(script_);
        const auto request = DecodeJobRequest(m.table);
        if (m.type == MessageType::kRenderJob && request)
          peer.frames_wanted += static_cast<uint32_t>(request->job.cameras.size()) - request->have;
        return c.Come(std::move(m));
      }
      case kBreak:
        return c.Break(script_.Below(2) == 0);
      case kReads:
        return c.SetReads(script_.Below(2) == 0);
      case kServesAt:
        return c.Come(MakeMessage(MessageType::kHello, Hello{Role::kWorker, "", 1, script_.Below(4),
                                                             static_cast<uint16_t>(script_.Number())}));
      default:
        return;
    }
  }

  /// The oldest tile that it was given. `how`: 0 to 2 right; else another lease, pixels or depths too few,
  /// once more.
  void Answer(Peer& peer, uint32_t how, uint8_t fill) {
    if (peer.orders.empty()) return;
    const TileOrder order = peer.orders.front();
    if (how != 5) peer.orders.pop_front();
    TileDone done{order.frame, order.tile, order.lease + (how == 3), 10, 1, 50, {}, {fill % 4u, fill / 4u}};
    done.depths.assign(
        size_t{DepthCells(order.area.pixels.width)} * DepthCells(order.area.pixels.height) - (how == 6),
        fill / 16.0f);
    if (how == 2) done.blocks.clear();
    Message m = MakeMessage(MessageType::kTileDone, done);
    m.raw.resize(
        size_t{order.area.pixels.width} * order.area.pixels.height * peer.words[order.frame] * 4 - (how == 4),
        std::byte{fill});
    peer.connection->Come(std::move(m));
  }

  void AnswerAll(Peer& peer) {
    while (!peer.orders.empty()) Answer(peer, 0, 0x3f);
  }

  /// One step of the end. True when nobody waits.
  bool AllServed() {
    if (!honest_) {
      for (const auto& peer : peers_) {
        if (!peer->frames_wanted) peer->connection->Break(false);
        peer->connection->SetReads(true);
      }
      honest_ = &Connect();
      honest_->connection->Come(
          MakeMessage(MessageType::kHello, Hello{Role::kWorker, "honest", 2, 1u << 20, 0}));
    }
    bool waits = false;
    for (const auto& peer : peers_) {
      waits = waits || peer->Waits();
      peer->connection->Come({MessageType::kPing, 0, {}, {}});
    }
    if (++steps_ < kSettle) return false;  // messages on their way arrive first
    if (!waits) return true;
    if (steps_ > kRounds) NeverEnds("a client's job");
    PassTime(*io_, 0.05);
    std::this_thread::sleep_for(std::chrono::microseconds(100));
    return false;
  }

  static constexpr double kTimes[] = {0.01, 0.25, 1, 5, 7, 30};
  static constexpr int kSettle = 20, kRounds = 100'000;
  Script& script_;
  boost::asio::io_context* io_ = nullptr;
  std::function<MemoryConnectionPtr()> accept_;
  std::vector<std::unique_ptr<Peer>> peers_;
  Peer* honest_ = nullptr;
  int steps_ = 0;
};

}  // namespace

std::vector<std::vector<uint8_t>> Seeds() {
  // The first two bytes are the policy and the master's other settings. Then two clients, each with a job,
  // and a worker that answers, or fails with tiles of both in its hands. A job (see AnyJob): sides, no crop,
  // mode, spp, seed, exposure, layers, format, number, no lights, frames, a camera for each, have.
  const std::vector<uint8_t> beginning = {
      kConnect, kConnect, kConnect, kHello, 1, 2,      1,    'c', 0, 0,    0,  kHello, 2,   2,
      1,        'd',      0,        0,      0, kHello, 0,    0,   1, 0xff, 1,  2,      1,   kWorkerStatus,
      0,        0,        2,        1,      2, 0,      kJob, 1,   0, 0,    1,  1,      0,   0,
      0,        0,        0,        0,      0, 0,      200,  90,  0, kJob, 2,  2,      3,   1,
      1,        0,        1,        0,      9, 1,      0,    0,   1, 200,  90, 100,    200, 0};
  const std::vector<uint8_t> answers = {kAnswer, 0, 0,          5, kTime,  1,     kAnswer, 0,
                                        3,       5, kAnswerAll, 0, kPause, kTime, 2};
  const std::vector<uint8_t> failure = {kTime, 1, kFail, 0, 1, 'x'};
  std::vector<std::vector<uint8_t>> seeds;
  for (uint8_t policy = 0; policy < 3; ++policy)
    for (uint8_t more = 0; more < 4; ++more)
      for (const auto& end : {answers, failure}) {
        std::vector<uint8_t> seed = {policy, more};
        seed.insert(seed.end(), beginning.begin(), beginning.end());
        seed.insert(seed.end(), end.begin(), end.end());
        seeds.push_back(std::move(seed));
      }
  return seeds;
}

}  // namespace quarry::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace quarry;
  static const test::TemporaryFolder folder;
  fuzz::Script script(data, size);
  MasterOptions options;
  options.scene = fuzz::StorePath();
  options.policy = static_cast<SchedulingPolicy>(script.Below(3));
  const uint8_t more = script.Byte();
  if (more & 1) options.spool = folder.file("spool");
  if (more & 2) options.trace = folder.file("trace");
  options.serve_only = more % 32 == 31;
  options.quiet = true;
  fuzz::MemoryNet net;
  fuzz::Cast cast(script);
  net.on_listen = [&](auto& io, auto accept) { cast.Begin(io, std::move(accept)); };
  const Status status = RunMaster(options);
  if (!status) std::abort();
  std::error_code ignored;
  if (more & 1) std::filesystem::remove_all(options.spool, ignored);
  return 0;
}
