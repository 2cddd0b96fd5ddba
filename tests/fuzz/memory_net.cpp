#include "tests/fuzz/memory_net.h"

#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <utility>

#include "common/protocol/frame.h"

namespace asio = boost::asio;

namespace {

std::atomic<int64_t> now_ns{1'000'000'000'000};
quarry::fuzz::MemoryNet* net = nullptr;

}  // namespace

// The clock of the programs under test, and of Asio's timers. libFuzzer keeps its limits by another one.
std::chrono::steady_clock::time_point std::chrono::steady_clock::now() noexcept {
  return time_point(duration(now_ns.load()));
}

namespace quarry {

void Connect(asio::io_context& io, const Endpoint& endpoint, const Security&,
             std::function<void(Result<std::shared_ptr<Connection>>)> done) {
  asio::post(io, [&io, endpoint, done = std::move(done)] {
    if (!net->on_connect(endpoint)) return done(Fail("cannot be reached"));
    auto connection = std::make_shared<fuzz::MemoryConnection>(io, endpoint);
    net->connections.push_back(connection);
    net->on_connected(connection);
    done(std::move(connection));
  });
}

namespace {

struct MemoryListener final : Listener {
  uint16_t port() const override { return 9000; }
};

}  // namespace

Result<std::unique_ptr<Listener>> Listener::Open(asio::io_context& io, const Endpoint&, const Security&,
                                                 OnConnection on_connection, ListenerOptions) {
  auto listener = std::make_unique<MemoryListener>();
  net->on_listen(io, [&io, on_connection = std::move(on_connection)] {
    auto connection = std::make_shared<fuzz::MemoryConnection>(io, Endpoint{});
    net->connections.push_back(connection);
    on_connection(connection);
    return connection;
  });
  return listener;
}

}  // namespace quarry

namespace quarry::fuzz {

MemoryNet::MemoryNet() { net = this; }

MemoryNet::~MemoryNet() {
  for (const auto& weak : connections)
    if (const auto connection = weak.lock()) connection->Release();
  net = nullptr;
}

std::shared_ptr<MemoryConnection> MemoryConnection::Self() {
  return std::static_pointer_cast<MemoryConnection>(shared_from_this());
}

void MemoryConnection::Start(OnMessage on_message, OnClose on_close) {
  on_message_ = std::move(on_message);
  on_close_ = std::move(on_close);
}

void MemoryConnection::Send(Message message) {
  const uint64_t bytes = kFrameHeaderBytes + message.table.size() + message.raw.size();
  queued_ += bytes;
  asio::post(io_, [self = Self(), message = std::move(message), bytes]() mutable {
    if (self->closed_) {
      self->queued_ -= bytes;
      return;
    }
    self->sent_.push_back(std::move(message));
    self->TakeSent();
  });
}

void MemoryConnection::TakeSent() {
  while (reads_ && !sent_.empty()) {
    Message message = std::move(sent_.front());
    sent_.pop_front();
    queued_ -= kFrameHeaderBytes + message.table.size() + message.raw.size();
    if (on_sent) on_sent(std::move(message));
    if (after_sent_) after_sent_();
  }
}

void MemoryConnection::Close() {
  close_asked_ = true;
  asio::post(io_, [self = Self()] {
    self->closed_ = true;
    self->on_message_ = nullptr;
    self->on_close_ = nullptr;
    self->after_sent_ = nullptr;
  });
}

void MemoryConnection::Come(Message message) {
  asio::post(io_, [self = Self(), message = std::move(message)]() mutable {
    if (self->closed_ || self->close_asked_ || !self->on_message_) return;
    // A message that the other side may not send is read no further than its header.
    if (!DecodeFrameHeader(EncodeFrameHeader(message), self->speaker_)) return self->Break(false);
    self->received_ += kFrameHeaderBytes + message.table.size() + message.raw.size();
    self->on_message_(std::move(message));
  });
}

void MemoryConnection::Break(bool permanent) {
  asio::post(io_, [self = Self(), permanent] {
    if (std::exchange(self->closed_, true)) return;
    const OnClose handler = std::exchange(self->on_close_, nullptr);
    self->on_message_ = nullptr;
    self->after_sent_ = nullptr;
    if (handler && !self->close_asked_)
      handler(Error{"the fuzz program closed the connection",
                    permanent ? ErrorKind::kPermanent : ErrorKind::kFailed});
  });
}

void MemoryConnection::SetReads(bool reads) {
  reads_ = reads;
  TakeSent();
}

void MemoryConnection::Release() {
  closed_ = true;
  on_message_ = nullptr;
  on_close_ = nullptr;
  on_sent = nullptr;
  after_sent_ = nullptr;
}

void PassTime(asio::io_context& io, double seconds) {
  now_ns += static_cast<int64_t>(seconds * 1e9);
  // One that is due before all others makes Asio look at them.
  auto timer = std::make_shared<asio::steady_timer>(io, std::chrono::steady_clock::time_point{});
  timer->async_wait([timer](const boost::system::error_code&) {});
}

void Repeat(asio::io_context& io, std::function<bool()> step) {
  asio::post(io, [&io, step = std::move(step)]() mutable {
    if (step()) Repeat(io, std::move(step));
  });
}

}  // namespace quarry::fuzz
