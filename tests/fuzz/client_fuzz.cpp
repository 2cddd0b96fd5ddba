// A client whose master follows the bytes, in any order and at any time, and whose disk takes frames or does
// not. At the end the master behaves and the disk has space: the client must have its frames, each once and
// in order, or have ended with a sentence.
#include <chrono>
#include <cstdlib>
#include <utility>
#include <vector>

#include "deploy/command/client.h"
#include "tests/fuzz/memory_net.h"
#include "tests/fuzz/session_script.h"

namespace quarry::fuzz {
namespace {

/// Actions that an input's bytes choose; the seeds are written in them.
enum Action : uint8_t {
  kWelcome,
  kProgress,
  kFrame,
  kFail,
  kAny,
  kBreak,
  kTime,
  kReach,
  kDisk,
  kReads,
  kActions
};

constexpr uint32_t kFirstFrame = 3, kFrames = 4;

class Cast {
 public:
  explicit Cast(Script& script) : script_(script) {}

  bool reachable() const { return reachable_ || !io_; }
  void OnConnected(const MemoryConnectionPtr& c) {
    c->on_sent = [this, &c = *c](const Message& m) { OnSent(c, m); };
    master_ = c;
    greeted_ = false;
    if (std::exchange(io_, &c->io()) == nullptr) Repeat(*io_, [this] { return Step(); });
  }

  Status OnFrame(const FrameDone& done, const Bytes&) {
    if (full_) return Fail("the disk is full");
    if (done.frame != kFirstFrame + stored_++) {
      std::fprintf(stderr, "frame %u is stored as number %u\n", done.frame, stored_ - 1);
      std::abort();
    }
    return {};
  }
  uint32_t stored() const { return stored_; }

 private:
  bool Step() {
    if (!script_.over()) {
      Act();
    } else {
      Finish();
    }
    return true;  // the client's end is the end
  }

  void OnSent(MemoryConnection& c, const Message& m) {
    if (m.type != MessageType::kRenderJob) return;
    const auto request = DecodeJobRequest(m.table);
    if (!request || request->job.cameras.size() != kFrames) std::abort();
    for (uint32_t f = request->have; last_ && f < kFrames; ++f) SendFrame(c, kFirstFrame + f);
  }

  static void SendFrame(MemoryConnection& c, uint32_t frame) {
    Message m = MakeMessage(MessageType::kFrameDone, FrameDone{frame, "{}"});
    m.raw = Bytes(9, static_cast<std::byte>(frame));
    c.Come(std::move(m));
  }

  void Act() {
    switch (script_.Below(kActions)) {
      case kWelcome: {
        SceneId scene{};
        if (script_.Below(8) == 7) scene[0] = 1;
        return master_->Come(MakeMessage(MessageType::kWelcome, Welcome{scene, 0, {}}));
      }
      case kProgress:
        return master_->Come(MakeMessage(
            MessageType::kFrameProgress,
            FrameProgress{script_.Number(), script_.Number(), script_.Number(), script_.Below(2)}));
      case kFrame:
        return SendFrame(*master_, kFirstFrame + script_.Below(kFrames));
      case kFail:
        return master_->Come(MakeMessage(MessageType::kFailure, Failure{"x" + script_.Text()}));
      case kAny:
        return master_->Come(AnyMessage(script_));
      case kBreak:
        return master_->Break(script_.Below(4) == 3);
      case kTime:
        return PassTime(*io_, kTimes[script_.Below(std::size(kTimes))]);
      case kReach:
        reachable_ = script_.Below(2) == 0;
        return;
      case kDisk:
        full_ = script_.Below(2) == 0;
        return;
      case kReads:
        return master_->SetReads(script_.Below(2) == 0);
    }
  }

  /// One step of the end.
  void Finish() {
    if (!std::exchange(last_, true)) {
      reachable_ = true;
      full_ = false;
      // Its requests on this connection may have no answer: on the next connection the client asks again.
      master_->Break(false);
    }
    if (++steps_ > kRounds) NeverEnds("a client whose frames are there");
    if (!master_->closed() && !std::exchange(greeted_, true))
      master_->Come(MakeMessage(MessageType::kWelcome, Welcome{SceneId{}, 0, {}}));
    master_->Come({MessageType::kPing, 0, {}, {}});
    PassTime(*io_, 0.05);
  }

  static constexpr double kTimes[] = {0.01, 0.2, 0.4, 1, 5, 7};
  static constexpr int kRounds = 20'000;
  Script& script_;
  boost::asio::io_context* io_ = nullptr;
  MemoryConnectionPtr master_;  ///< the newest
  bool reachable_ = true, full_ = false, greeted_ = false, last_ = false;
  uint32_t stored_ = 0;
  int steps_ = 0;
};

}  // namespace

std::vector<std::vector<uint8_t>> Seeds() {
  return {
      {},
      {kWelcome, 0, kProgress, 3, 1,        4, 1,      kFrame, 0,      kFrame, 1,
       kBreak,   0, kTime,     2, kWelcome, 0, kFrame, 2,      kFrame, 3},
      {kWelcome, 0,     kDisk, 0,      kFrame, 0,     kTime, 3,      kTime, 3,     kDisk,
       1,        kTime, 3,     kFrame, 1,      kTime, 5,     kReach, 0,     kTime, 4},
      {kWelcome, 0, kFrame, 0, kReads, 1, kTime, 5, kTime, 2, kWelcome, 7, kTime, 2, kWelcome, 0, kFail, 0},
      {kReach, 1, kBreak, 3, kTime, 2},
      {kWelcome, 0, kProgress, 3, 0, 4, 0, kTime, 4, kProgress, 3, 0, 4, 0, kAny, 5, 0, 5, 3, 0}};
}

}  // namespace quarry::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace quarry;
  fuzz::Script script(data, size);
  RenderJob job;
  job.first_frame = fuzz::kFirstFrame;
  for (uint32_t f = 0; f < fuzz::kFrames; ++f) job.cameras.push_back({{f + 1.0, 2, 3}, {0, 0, 0}, {0, 0, 1}});
  if (!NormalizeJob(job)) std::abort();
  fuzz::MemoryNet net;
  fuzz::Cast cast(script);
  net.on_connect = [&](const Endpoint&) { return cast.reachable(); };
  net.on_connected = [&](const auto& connection) { cast.OnConnected(connection); };
  RenderCallbacks callbacks;
  callbacks.on_progress = [](const FrameProgress&) {};
  callbacks.on_frame = [&](const FrameDone& done, const Bytes& image) { return cast.OnFrame(done, image); };
  callbacks.check = [] { return Status{}; };
  callbacks.say = [](const std::string&) {};
  const Endpoint master{"127.0.0.1", 1};
  const SceneId scene{};
  const Status status = RenderRemotely(master, Security(), scene, job, callbacks, 20);
  if (status ? cast.stored() != fuzz::kFrames : status.error().message.empty()) std::abort();
  return 0;
}
