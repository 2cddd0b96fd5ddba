#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <deque>
#include <functional>
#include <memory>
#include <string>

#include "common/net/connection.h"

/// Stands in for common/net/connection.cpp, whose functions memory_net.cpp defines instead: a program under
/// test connects to the fuzz program, and is connected to by it, in the same process and thread. Stands in
/// for the clock too: time stands still unless it is moved. Programs are unchanged by it.
namespace quarry::fuzz {

/// A connection as the program under test has it; `Come`, `Break` and `sent` are the other side's. On one
/// thread, but for Send and Close.
class MemoryConnection final : public Connection {
 public:
  MemoryConnection(boost::asio::io_context& io, Endpoint endpoint)
      : io_(io), endpoint_(std::move(endpoint)) {}

  void Start(OnMessage on_message, OnClose on_close) override;
  void Expect(Speaker speaker, uint32_t) override { speaker_ = speaker; }
  void Send(Message message) override;
  void Close() override;
  uint64_t queued_bytes() const override { return queued_; }
  uint64_t taken_bytes() const override { return reads_ ? 1u << 20 : 0; }
  double unread_s() const override { return queued_ == 0 || reads_ ? 0 : 100; }
  void SetOnSent(std::function<void()> on_sent) override { after_sent_ = std::move(on_sent); }
  uint64_t received_bytes() const override { return received_; }
  const std::string& peer() const override { return peer_; }
  std::string local_host() const override { return "127.0.0.1"; }

  /// The message arrives, when those before it have.
  void Come(Message message);
  /// The connection is lost.
  void Break(bool permanent);
  /// The program has closed it, or it was broken.
  bool closed() const { return closed_; }
  /// Where the program has connected to.
  const Endpoint& endpoint() const { return endpoint_; }
  boost::asio::io_context& io() const { return io_; }
  /// Called with each message that the program sends, on the io_context's thread; unread messages wait until
  /// SetReads(true).
  std::function<void(Message)> on_sent;
  void SetReads(bool reads);
  /// For the end, when no io_context runs any more: drops the handlers, which may hold this connection.
  void Release();

 private:
  std::shared_ptr<MemoryConnection> Self();
  void TakeSent();

  boost::asio::io_context& io_;
  const Endpoint endpoint_;
  const std::string peer_ = "127.0.0.1:40000";
  Speaker speaker_ = Speaker::kAnyone;
  std::function<void()> after_sent_;
  OnMessage on_message_;
  OnClose on_close_;
  std::deque<Message> sent_;
  bool reads_ = true, closed_ = false;
  std::atomic<bool> close_asked_{false};
  uint64_t received_ = 0;
  std::atomic<uint64_t> queued_{0};
};
using MemoryConnectionPtr = std::shared_ptr<MemoryConnection>;

/// The network of the program under test, as hooks; one instance at a time.
struct MemoryNet {
  /// The program wants to connect: whether it can. `connected` follows.
  std::function<bool(const Endpoint&)> on_connect = [](const Endpoint&) { return true; };
  /// Before Start.
  std::function<void(const MemoryConnectionPtr&)> on_connected = [](const MemoryConnectionPtr&) {};
  /// The program listens: `accept` hands it a connection.
  std::function<void(boost::asio::io_context&, std::function<MemoryConnectionPtr()> accept)> on_listen =
      [](auto&, auto) {};

  MemoryNet();
  /// Requires: the program's io_context does not run any more, but exists or has never had connections.
  ~MemoryNet();
  std::deque<std::weak_ptr<MemoryConnection>> connections;  ///< all there have been
};

/// Moves the clock on; timers that end by then are due.
void PassTime(boost::asio::io_context& io, double seconds);
/// Calls `step` again and again, each time after all that is due; until it returns false.
void Repeat(boost::asio::io_context& io, std::function<bool()> step);

}  // namespace quarry::fuzz
