#include "deploy/client.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <utility>

namespace quarry {
namespace {

namespace asio = boost::asio;

class Client {
 public:
  Client(const SceneId& scene, const RenderJob& job, const RenderCallbacks& callbacks)
      : scene_(scene), job_(job), callbacks_(callbacks), timer_(io_), frames_left_(job.cameras.size()) {}

  Status Run(const Endpoint& master, const Security& security) {
    Connect(io_, master, security, [this](Result<std::shared_ptr<Connection>> result) {
      if (!result) return End(tl::unexpected<Error>(result.error()));
      connection_ = std::move(*result);
      connection_->Start([this](Message m) { OnMessage(std::move(m)); },
                         [this](const Error& e) { OnLost(e); });
      connection_->Send(MakeMessage(MessageType::kHello, Hello{Role::kClient, "quarry", 0}));
    });
    Tick();
    io_.run();
    return outcome_;
  }

 private:
  void End(Status outcome) {
    outcome_ = std::move(outcome);
    io_.stop();
  }

  /// When the master has died, its own words say more than the broken connection.
  void OnLost(const Error& error) {
    const Status why = callbacks_.check();
    End(why ? Status(tl::unexpected<Error>(error)) : why);
  }

  void Tick() {
    if (Status status = callbacks_.check(); !status) return End(std::move(status));
    timer_.expires_after(std::chrono::milliseconds(200));
    timer_.async_wait([this](const boost::system::error_code& e) {
      if (!e) Tick();
    });
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
    if (welcome.scene_id != scene_) return Fail("the master serves another scene than the one named");
    connection_->Send(MakeMessage(MessageType::kRenderJob, job_));
    return {};
  }

  Status OnProgress(const Message& m) {
    QUARRY_ASSIGN(const FrameProgress progress, DecodeFrameProgress(m.table));
    callbacks_.on_progress(progress);
    return {};
  }

  Status OnFrame(Message m) {
    QUARRY_ASSIGN(const FrameDone done, DecodeFrameDone(m.table));
    QUARRY_TRY(callbacks_.on_frame(done, std::move(m.raw)));
    if (--frames_left_ == 0) End({});
    return {};
  }

  const SceneId& scene_;
  const RenderJob& job_;
  const RenderCallbacks& callbacks_;
  asio::io_context io_;
  asio::steady_timer timer_;
  std::shared_ptr<Connection> connection_;
  size_t frames_left_;
  Status outcome_;
};

}  // namespace

Status RenderRemotely(const Endpoint& master, const Security& security, const SceneId& scene,
                      const RenderJob& job, const RenderCallbacks& callbacks) {
  Client client(scene, job, callbacks);
  return client.Run(master, security);
}

}  // namespace quarry
