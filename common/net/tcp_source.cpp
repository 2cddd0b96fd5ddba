#include "common/net/tcp_source.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <utility>

#include "common/protocol/messages.h"

namespace quarry {

struct TcpVoxelSource::Impl : std::enable_shared_from_this<TcpVoxelSource::Impl> {
  struct Waiting {
    uint32_t block;
    Done done;
  };
  Impl(boost::asio::io_context& context, Endpoint e, Security s, SceneId id, double limit)
      : io(context),
        server(std::move(e)),
        security(std::move(s)),
        scene(id),
        give_up_after(limit),
        timer(context) {}

  void Reconnect() {
    Connect(io, server, security, [self = shared_from_this()](Result<std::shared_ptr<Connection>> result) {
      if (self->stopped) return;
      if (!result) return self->Lost(result.error());
      self->connection = *result;
      self->connection->Start([self](Message m) { self->OnMessage(std::move(m)); },
                              [self](const Error& e) { self->Lost(e); });
      self->connection->Send(MakeMessage(MessageType::kHello, Hello{Role::kVoxels, "voxels", 0}));
    });
  }

  void Lost(const Error& error) {
    if (stopped) return;
    connection.reset();
    ready = false;
    const auto now = std::chrono::steady_clock::now();
    if (!lost) lost_since = now;
    lost = true;
    if (error.permanent || std::chrono::duration<double>(now - lost_since).count() > give_up_after)
      return FailAll(error);
    timer.expires_after(std::chrono::seconds(1));
    timer.async_wait([self = shared_from_this()](const boost::system::error_code& e) {
      if (!e && !self->stopped) self->Reconnect();
    });
  }

  void FailAll(const Error& error) {
    auto all = std::exchange(waiting, {});
    for (auto& [request, w] : all) w.done(tl::unexpected<Error>(error));
  }

  void OnMessage(Message m) {
    if (m.type == MessageType::kWelcome) return OnWelcome(m);
    const auto it = waiting.find(m.request);
    if (it == waiting.end()) return;
    Done done = std::move(it->second.done);
    waiting.erase(it);
    if (m.type == MessageType::kBlock) return done(std::move(m.raw));
    const auto failure = DecodeFailure(m.table);
    done(Fail(failure ? failure->message : "the voxel server gave an answer that is not one"));
  }

  void OnWelcome(const Message& m) {
    const auto welcome = DecodeWelcome(m.table);
    if (!welcome || welcome->scene_id != scene) {
      connection->Close();
      return FailAll(Error{"the voxel server has another scene now"});
    }
    lost = false;
    ready = true;
    for (const auto& [request, w] : waiting) Ask(request, w.block);
  }

  void Ask(uint64_t request, uint32_t block) {
    connection->Send(MakeMessage(MessageType::kBlockRequest, BlockRequest{block}, request));
  }

  boost::asio::io_context& io;
  Endpoint server;
  Security security;
  SceneId scene;
  double give_up_after;
  boost::asio::steady_timer timer;
  std::shared_ptr<Connection> connection;
  std::unordered_map<uint64_t, Waiting> waiting;
  uint64_t next_request = 1;
  bool ready = false, lost = false, stopped = false;
  std::chrono::steady_clock::time_point lost_since;
};

TcpVoxelSource::TcpVoxelSource(boost::asio::io_context& io, Endpoint server, Security security, SceneId scene,
                               double give_up_after_s)
    : impl_(std::make_shared<Impl>(io, std::move(server), std::move(security), scene, give_up_after_s)) {
  impl_->Reconnect();
}

TcpVoxelSource::~TcpVoxelSource() {
  impl_->stopped = true;
  impl_->timer.cancel();
  impl_->waiting.clear();
  if (impl_->connection) impl_->connection->Close();
}

void TcpVoxelSource::Fetch(uint32_t block, Done done) {
  const uint64_t request = impl_->next_request++;
  impl_->waiting.emplace(request, Impl::Waiting{block, std::move(done)});
  if (impl_->ready) impl_->Ask(request, block);
}

}  // namespace quarry
