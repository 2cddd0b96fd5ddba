#include "deploy/command/client.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <deque>
#include <thread>
#include <utility>

#include "common/base/resource.h"
#include "common/net/liveness_monitor.h"
#include "common/net/timer.h"
#include "common/protocol/messages.h"

namespace quarry {
namespace {

namespace asio = boost::asio;

constexpr int kUnusableArguments = 2;  // an exit status

class Client {
 public:
  Client(const Endpoint& master, const Security& security, const SceneId& scene, const RenderJob& job,
         const RenderCallbacks& callbacks, double retry_s)
      : master_(master),
        security_(security),
        scene_(scene),
        job_(job),
        callbacks_(callbacks),
        retry_s_(retry_s),
        timer_(io_),
        retry_(io_) {}

  Status Run() {
    Reach();
    Tick();
    io_.run();
    return outcome_;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static double Now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }

  void Reach() {
    Connect(io_, master_, security_, [this](Result<std::shared_ptr<Connection>> result) {
      if (!result) return OnLost(result.error());
      connection_ = std::move(*result);
      liveness_.Add(connection_, Now());
      // Messages of an abandoned connection that arrive late are ignored.
      const Connection* const mine = connection_.get();
      connection_->Expect(Speaker::kMasterOfClients);
      connection_->Start(
          [this, mine](Message m) {
            if (mine == connection_.get()) OnMessage(std::move(m));
          },
          [this, mine](const Error& e) {
            if (mine == connection_.get()) OnLost(e);
          });
      connection_->Send(MakeMessage(MessageType::kHello, Hello{Role::kClient, "quarry", 0}));
    });
  }

  void End(Status outcome) {
    outcome_ = std::move(outcome);
    io_.stop();
  }

  /// Decides whether to connect again. When the master of a local cluster has died, its own message is
  /// reported, since it says more than the broken connection. A mismatch of secret or version after a first
  /// Welcome is damage on the way and is retried.
  void OnLost(const Error& error) {
    if (connection_) {
      connection_->Close();
      liveness_.Forget(connection_);
    }
    connection_.reset();
    if (callbacks_.check)
      if (Status why = callbacks_.check(); !why) return End(std::move(why));
    if (std::exchange(welcomed_, false)) {
      lost_ = Clock::now();
      callbacks_.say(fmt::format("lost the master, retrying for {:.0f} s: {}", retry_s_, error.message));
    }
    if (!was_welcomed_ || SecondsSince(lost_) > retry_s_) return End(ReasonFor(error));
    retry_.Set(0.3, [this] { Reach(); });
  }

  /// The system closes a dying master's connections a moment before it tells of the death, which says more.
  Status ReasonFor(const Error& error) const {
    const int tries = callbacks_.check ? 15 : 0;
    for (int i = 0; i < tries; ++i) {
      if (Status why = callbacks_.check(); !why) return why;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    return tl::unexpected<Error>(error);
  }

  void Tick() {
    if (callbacks_.check)
      if (Status status = callbacks_.check(); !status) return End(std::move(status));
    if (Status status = StoreFrames(); !status) return End(std::move(status));
    Heartbeat();
    timer_.Set(0.2, [this] { Tick(); });
  }

  void Heartbeat() {
    liveness_.Beat(Now());
    if (!liveness_.Silent(Now()).empty())
      OnLost(Error{fmt::format("the master has been silent for {:.0f} s", kSilenceS)});
  }

  void OnMessage(Message m) {
    Status status;
    switch (m.type) {
      case MessageType::kWelcome:
        status = OnWelcome(m);
        break;
      case MessageType::kFrameProgress:
        status = OnProgress(m);
        break;
      case MessageType::kFrameDone:
        status = OnFrame(std::move(m));
        break;
      case MessageType::kPing:
        break;
      case MessageType::kFarewell: {
        const auto farewell = DecodeFailure(m.table);
        return OnLost(farewell ? Error{farewell->message} : farewell.error());
      }
      case MessageType::kFailure: {
        const auto failure = DecodeFailure(m.table);
        status = Fail(failure ? failure->message : failure.error().message);
        break;
      }
      default:
        status = Fail("the master sent a message that is not for clients");
    }
    if (!status) End(std::move(status));
  }

  Status OnWelcome(const Message& m) {
    QUARRY_ASSIGN(const Welcome welcome, DecodeWelcome(m.table));
    if (welcome.scene_id != scene_) {
      const std::string sentence = "the master serves another scene than the one named";
      if (!was_welcomed_) return Fail(sentence);
      OnLost(Error{sentence});
      return {};
    }
    welcomed_ = was_welcomed_ = true;
    connection_->Send(MakeMessage(MessageType::kRenderJob,
                                  JobRequest{job_, static_cast<uint32_t>(stored_ + frames_.size())}));
    return {};
  }

  Status OnProgress(const Message& m) {
    QUARRY_ASSIGN(const FrameProgress progress, DecodeFrameProgress(m.table));
    if (progress.workers > 0)
      alone_ = {};
    else if (alone_ == Clock::time_point{})
      alone_ = Clock::now();
    if (progress.workers == 0 && SecondsSince(alone_) > 5 && !std::exchange(told_alone_, true))
      callbacks_.say("the master has no workers; waiting for some");
    if (progress.tiles > 0) callbacks_.on_progress(progress);
    return {};
  }

  Status OnFrame(Message m) {
    QUARRY_ASSIGN(const FrameDone done, DecodeFrameDone(m.table));
    if (const size_t expected = job_.first_frame + stored_ + frames_.size(); done.frame != expected)
      return Fail(fmt::format("the master sent frame {} where {} was expected", done.frame, expected));
    frames_.push_back({done, std::move(m.raw)});
    return StoreFrames();
  }

  /// Stores the frames that have arrived, in order.
  Status StoreFrames() {
    while (!frames_.empty()) {
      if (failing_ && SecondsSince(tried_) < 1) return {};
      tried_ = Clock::now();
      if (Status status = callbacks_.on_frame(frames_.front().first, frames_.front().second); !status) {
        // A full disk may get space; an unusable path stays unusable.
        if (status.error().exit_status() == kUnusableArguments) return status;
        if (!std::exchange(failing_, true)) {
          failing_since_ = Clock::now();
          callbacks_.say(fmt::format("{}; trying again for {:.0f} s", status.error().message, retry_s_));
        }
        return SecondsSince(failing_since_) > retry_s_ ? status : Status{};
      }
      failing_ = false;
      frames_.pop_front();
      ++stored_;
    }
    if (stored_ == job_.cameras.size()) End({});
    return {};
  }

  const Endpoint& master_;
  const Security& security_;
  const SceneId& scene_;
  const RenderJob& job_;
  const RenderCallbacks& callbacks_;
  const double retry_s_;
  asio::io_context io_;
  Timer timer_, retry_;
  std::shared_ptr<Connection> connection_;
  std::deque<std::pair<FrameDone, Bytes>> frames_;  ///< arrived, not yet stored
  size_t stored_ = 0;
  bool welcomed_ = false, was_welcomed_ = false, failing_ = false, told_alone_ = false;
  Clock::time_point alone_;  ///< start of the time without workers; zero while there are some
  Clock::time_point lost_, tried_, failing_since_;
  LivenessMonitor liveness_;  ///< of the master
  Status outcome_;
};

}  // namespace

Status RenderRemotely(const Endpoint& master, const Security& security, const SceneId& scene,
                      const RenderJob& job, const RenderCallbacks& callbacks, double retry_s) {
  Client client(master, security, scene, job, callbacks, retry_s);
  return client.Run();
}

}  // namespace quarry
