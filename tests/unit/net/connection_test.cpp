#include "common/net/connection.h"

#include <unistd.h>

#include <algorithm>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <catch2/catch.hpp>
#include <chrono>
#include <cstdlib>
#include <deque>
#include <fstream>
#include <functional>
#include <optional>
#include <thread>

#include "common/net/timer.h"
#include "common/protocol/messages.h"
#include "master/block_service.h"
#include "tests/support/stores/voxel_blocks.h"
#include "worker/sources/tcp_source.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using ConnectionPtr = std::shared_ptr<Connection>;

SecurityOptions Secret(char fill) {
  char path[] = "/tmp/quarry-secret-XXXXXX";
  const int fd = ::mkstemp(path);  // of mode 600
  REQUIRE(fd >= 0);
  const std::string text(32, fill);
  REQUIRE(::write(fd, text.data(), text.size()) == 32);
  ::close(fd);
  return {path, {}, {}, {}};
}

Security WithSecret(char fill, bool server) {
  const SecurityOptions options = Secret(fill);
  const auto security = server ? Security::ForServer(options) : Security::ForClient(options);
  ::unlink(options.secret_file.c_str());
  REQUIRE(security.has_value());
  return *security;
}

/// One end of a connection, and the messages received there.
struct End {
  ConnectionPtr connection;
  std::vector<Message> messages;
  std::optional<Error> closed;
  std::function<void()> on_message = [] {};

  void Start(ConnectionPtr c) {
    connection = std::move(c);
    connection->Start(
        [this](Message m) {
          messages.push_back(std::move(m));
          on_message();
        },
        [this](const Error& e) { closed = e; });
  }
};

/// A listener and connections to it; each side on an io_context of its own, so that one side can stand still.
struct Network {
  explicit Network(Security security) {
    auto opened = Listener::Open(server_io, {"127.0.0.1", 0}, security, [this](ConnectionPtr c) {
      accepted.push_back(std::make_unique<End>());
      accepted.back()->Start(std::move(c));
    });
    REQUIRE(opened.has_value());
    listener = std::move(*opened);
  }

  /// Runs both sides until `done`, or for a minute.
  template <class Done>
  bool Run(Done done) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
    while (!done() && std::chrono::steady_clock::now() < end) {
      server_io.restart();
      client_io.restart();
      server_io.run_for(std::chrono::milliseconds(1));
      client_io.run_for(std::chrono::milliseconds(1));
    }
    return done();
  }

  End& ConnectTo(const Security& security) {
    clients.push_back(std::make_unique<End>());
    End& end = *clients.back();
    Connect(client_io, {"127.0.0.1", listener->port()}, security, [&end](Result<ConnectionPtr> c) {
      if (c) {
        end.Start(*c);
      } else {
        end.closed = c.error();
      }
    });
    return end;
  }

  asio::io_context server_io, client_io;
  std::vector<std::unique_ptr<End>> accepted, clients;
  std::unique_ptr<Listener> listener;
};

Message Greeting() { return MakeMessage(MessageType::kHello, Hello{Role::kVoxels, "test", 0}); }

Message Block(size_t size, uint64_t request) {
  Message m{MessageType::kBlock, request, {}, Bytes(size)};
  for (size_t i = 0; i < size; ++i) m.raw[i] = static_cast<std::byte>(i * 31 + request);
  return m;
}

/// Answers when the test says so.
struct HeldSource final : VoxelSource {
  std::deque<Done> asked;
  void Fetch(BlockKey, Done done) override { asked.push_back(std::move(done)); }
  void AnswerOne() {
    const Done done = std::move(asked.front());
    asked.pop_front();
    done(Bytes(10));
  }
};

Message Request(uint32_t block) {
  return MakeMessage(MessageType::kBlockRequest, BlockRequest{block}, block + 1);
}

}  // namespace

TEST_CASE("Messages arrive as they were sent, plain and by TLS") {
  const bool tls = GENERATE(false, true);
  Network network(tls ? WithSecret('a', true) : Security());
  End& client = network.ConnectTo(tls ? WithSecret('a', false) : Security());
  REQUIRE(network.Run([&] { return client.connection && !network.accepted.empty(); }));
  End& server = *network.accepted[0];
  client.connection->Send(Greeting());
  for (uint64_t i = 0; i < 4; ++i) {
    client.connection->Send(Block(20'000'000 + i, i));
    server.connection->Send(Block(3'000'000 + i, i));
  }
  REQUIRE(network.Run([&] { return server.messages.size() == 5 && client.messages.size() == 4; }));
  CHECK(DecodeHello(server.messages[0].table)->name == "test");
  for (uint64_t i = 0; i < 4; ++i) {
    CHECK(
        (server.messages[i + 1].request == i && server.messages[i + 1].raw == Block(20'000'000 + i, i).raw));
    CHECK((client.messages[i].request == i && client.messages[i].raw == Block(3'000'000 + i, i).raw));
  }
  CHECK(client.connection->queued_bytes() == 0);
}

TEST_CASE("Close sends what is queued first") {
  const bool tls = GENERATE(false, true);
  Network network(tls ? WithSecret('a', true) : Security());
  End& client = network.ConnectTo(tls ? WithSecret('a', false) : Security());
  REQUIRE(network.Run([&] { return client.connection != nullptr; }));
  client.connection->Send(Greeting());
  client.connection->Send(Block(40'000'000, 7));
  client.connection->Close();
  REQUIRE(network.Run([&] { return network.accepted.size() == 1 && network.accepted[0]->closed; }));
  INFO(network.accepted[0]->closed->message);
  REQUIRE(network.accepted[0]->messages.size() == 2);
  CHECK(network.accepted[0]->messages[1].raw == Block(40'000'000, 7).raw);
  CHECK_THAT(network.accepted[0]->closed->message, Catch::Contains("closed the connection"));
  CHECK_FALSE(client.closed);
}

TEST_CASE("A last message arrives, though its sender closed before it had read everything") {
  const bool tls = GENERATE(false, true);
  Network network(tls ? WithSecret('a', true) : Security());
  End& client = network.ConnectTo(tls ? WithSecret('a', false) : Security());
  REQUIRE(network.Run([&] { return client.connection != nullptr; }));
  client.connection->Send(Greeting());
  REQUIRE(
      network.Run([&] { return network.accepted.size() == 1 && network.accepted[0]->messages.size() == 1; }));
  End& server = *network.accepted[0];
  for (int i = 0; i < 20; ++i) server.connection->Send(Block(1'000'000, 1));
  network.server_io.restart();
  network.server_io.run_for(std::chrono::milliseconds(50));
  client.connection->Send(Block(1000, 3));
  client.connection->Close();
  network.client_io.restart();
  network.client_io.run_for(std::chrono::milliseconds(50));
  REQUIRE(network.Run([&] { return server.closed.has_value(); }));
  REQUIRE(server.messages.size() == 2);
  CHECK(server.messages[1].raw == Block(1000, 3).raw);
}

TEST_CASE("After Close nothing is delivered, not even bytes that have arrived") {
  Network network{Security()};
  for (int i = 0; i < 2; ++i) network.ConnectTo({});
  int turns = 0;  // until all that comes before a greeting has been read
  REQUIRE(network.Run([&] { return network.accepted.size() == 2 && ++turns > 20; }));
  End &first = *network.accepted[0], &second = *network.accepted[1];
  first.on_message = [&] { second.connection->Close(); };
  second.on_message = [&] { first.connection->Close(); };
  for (const auto& client : network.clients) client->connection->Send(Greeting());
  // Both are here before the server's side looks.
  network.client_io.restart();
  network.client_io.run_for(std::chrono::milliseconds(50));
  network.server_io.restart();
  network.server_io.run_for(std::chrono::milliseconds(100));
  CHECK(first.messages.size() + second.messages.size() == 1);
}

TEST_CASE("A closed connection is destroyed, though nobody runs its io_context any more") {
  Network network{Security()};
  std::weak_ptr<Connection> watched;
  {
    asio::io_context io;
    Connect(io, {"127.0.0.1", network.listener->port()}, {}, [&](Result<ConnectionPtr> c) {
      REQUIRE(c.has_value());
      watched = *c;
      // Its own handlers hold it, as in a program that waits for answers.
      (*c)->Start([c = *c](const Message&) {}, [c = *c](const Error&) {});
    });
    while (watched.expired()) io.run_one();
    io.run_for(std::chrono::milliseconds(5));
    watched.lock()->Close();
  }
  CHECK(watched.expired());
}

TEST_CASE("Close does not wait for a peer that no longer answers or reads", "[long]") {
  const auto [tls, queued] = GENERATE(table<bool, size_t>({{false, 0}, {true, 0}, {true, 60'000'000}}));
  Network network(tls ? WithSecret('a', true) : Security());
  End& client = network.ConnectTo(tls ? WithSecret('a', false) : Security());
  REQUIRE(network.Run([&] { return client.connection != nullptr; }));
  client.connection->Send(Greeting());
  REQUIRE(
      network.Run([&] { return network.accepted.size() == 1 && network.accepted[0]->messages.size() == 1; }));
  // From here on the client's side stands still.
  End& server = *network.accepted[0];
  const std::weak_ptr<Connection> watched = server.connection;
  if (queued) server.connection->Send(Block(queued, 1));
  server.connection->Close();
  server.connection.reset();
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (!watched.expired() && std::chrono::steady_clock::now() < end) {
    network.server_io.restart();
    network.server_io.run_for(std::chrono::milliseconds(5));
  }
  CHECK(watched.expired());
}

TEST_CASE("Incompatible peers disconnect for good, and others continue") {
  const Security secret = WithSecret('a', true);
  struct Case {
    Security server, client;
    const char *at_server, *at_client;
  };
  const Case cases[] = {
      {secret, WithSecret('b', false), "has another secret", "does not take this side's secret"},
      {secret, Security(), "does not speak TLS", "asks for TLS"},
      {Security(), WithSecret('a', false), "speaks TLS", "does not speak TLS"},
  };
  for (const Case& c : cases) {
    INFO(c.at_server);
    Network network(c.server);
    End& stranger = network.ConnectTo(c.client);
    REQUIRE(network.Run([&] { return stranger.connection != nullptr; }));
    stranger.connection->Send(Greeting());
    End& friendly = network.ConnectTo(c.server.tls() ? WithSecret('a', false) : Security());
    REQUIRE(network.Run([&] { return friendly.connection != nullptr; }));
    friendly.connection->Send(Greeting());
    REQUIRE(network.Run([&] {
      return network.accepted.size() == 2 && network.accepted[0]->closed && stranger.closed &&
             network.accepted[1]->messages.size() == 1;
    }));
    CHECK_THAT(network.accepted[0]->closed->message, Catch::Contains(c.at_server));
    CHECK_THAT(stranger.closed->message, Catch::Contains(c.at_client));
    CHECK(stranger.closed->permanent());
    CHECK(network.accepted[0]->messages.empty());
    CHECK(stranger.messages.empty());
    CHECK_FALSE(friendly.closed);
  }
}

TEST_CASE("Beyond 64 connections without a greeting the oldest is dropped") {
  Network network{Security()};
  std::vector<tcp::socket> idle;
  End& greeted = network.ConnectTo({});
  REQUIRE(network.Run([&] { return greeted.connection != nullptr; }));
  greeted.connection->Send(Greeting());
  REQUIRE(
      network.Run([&] { return network.accepted.size() == 1 && network.accepted[0]->messages.size() == 1; }));
  for (size_t i = 0; i < 66; ++i) {
    idle.emplace_back(network.client_io);
    idle.back().connect({asio::ip::make_address("127.0.0.1"), network.listener->port()});
    REQUIRE(network.Run([&] { return network.accepted.size() == i + 2; }));
  }
  CHECK_FALSE(network.accepted[0]->closed);
  for (size_t i = 1; i < network.accepted.size(); ++i) {
    INFO(i);
    CHECK(network.accepted[i]->closed.has_value() == (i <= 2));
  }
}

TEST_CASE("A first message that is not a greeting is not read") {
  Network network{Security()};
  tcp::socket peer(network.client_io);
  peer.connect({asio::ip::make_address("127.0.0.1"), network.listener->port()});
  Message claim{MessageType::kRenderJob, 1, Bytes(1 << 20), {}};
  asio::write(peer, asio::buffer(EncodePreamble()));
  asio::write(peer, asio::buffer(EncodeFrameHeader(claim)));
  REQUIRE(network.Run([&] { return network.accepted.size() == 1 && network.accepted[0]->closed; }));
  CHECK_THAT(network.accepted[0]->closed->message, Catch::Contains("type 5, which is not a greeting"));
}

TEST_CASE("A message with a changed bit drops the connection and is not delivered") {
  const Message greeting = Greeting();
  Bytes good = EncodePreamble();
  for (const Bytes& part : {EncodeFrameHeader(greeting), greeting.table})
    good.insert(good.end(), part.begin(), part.end());
  // In the magic, the type, a length, a checksum and the content.
  for (const size_t at : {0, 4, 16, 21, 26, 33, 45}) {
    INFO(at);
    Network network{Security()};
    tcp::socket peer(network.client_io);
    peer.connect({asio::ip::make_address("127.0.0.1"), network.listener->port()});
    Bytes bad = good;
    bad[kPreambleBytes + at] ^= std::byte{2};
    asio::write(peer, asio::buffer(bad));
    REQUIRE(network.Run([&] { return network.accepted.size() == 1 && network.accepted[0]->closed; }));
    CHECK_THAT(network.accepted[0]->closed->message,
               Catch::Contains(at == 0 ? "not a Quarry message" : "damaged on its way"));
    CHECK_FALSE(network.accepted[0]->closed->permanent());
    CHECK(network.accepted[0]->messages.empty());
  }
}

TEST_CASE("A failed handshake with a voxel server is not final for a block") {
  // Flipped bits in a handshake look like another secret.
  Network network(WithSecret('a', true));
  const Catalog catalog = test::CatalogOf(2, 1000);
  for (const auto& [security, sentence] :
       {std::pair(WithSecret('b', false), "secret"), std::pair(Security(), "asks for TLS")}) {
    TcpVoxelSource source(network.client_io, {"127.0.0.1", network.listener->port()}, security, catalog);
    std::optional<Result<Bytes>> got;
    source.Fetch(3_b, [&](Result<Bytes> r) { got = std::move(r); });
    REQUIRE(network.Run([&] { return got.has_value(); }));
    REQUIRE_FALSE(got->has_value());
    CHECK_THAT(got->error().message, Catch::Contains(sentence));
    CHECK_FALSE(got->error().permanent());
  }
}

TEST_CASE("However many blocks are wanted, a server gets no more requests at once than its limit", "[long]") {
  constexpr size_t kWanted = 3 * kMostBlockRequests + 7;
  Network network{Security()};
  const Catalog catalog = test::CatalogOf(kWanted / 2 + 1, 10);
  TcpVoxelSource source(network.client_io, {"127.0.0.1", network.listener->port()}, {}, catalog);
  size_t came = 0;
  for (uint32_t b = 0; b < kWanted; ++b)
    source.Fetch(test::VoxelBlock(b), [&](const Result<Bytes>& r) { came += r.has_value(); });
  REQUIRE(
      network.Run([&] { return network.accepted.size() == 1 && network.accepted[0]->messages.size() == 1; }));
  End& server = *network.accepted[0];
  server.connection->Send(MakeMessage(MessageType::kWelcome, Welcome{SceneId{}, 0, {}}));
  HeldSource held;
  BlockService service(held, catalog);
  size_t taken = 1;  // without the greeting
  const auto serve = [&] {
    for (; taken < server.messages.size(); ++taken)
      if (server.messages[taken].type == MessageType::kBlockRequest)
        REQUIRE(service.Answer(server.connection, server.messages[taken]).has_value());
    return held.asked.size();
  };
  REQUIRE(network.Run([&] { return serve() == kMostBlockRequests; }));
  // One more only for one that has been answered.
  for (size_t i = 0; i < 20; ++i) {
    held.AnswerOne();
    REQUIRE(network.Run([&] { return came == i + 1 && serve() == kMostBlockRequests; }));
  }
  REQUIRE(network.Run([&] {
    if (serve() > 0) held.AnswerOne();
    return came == kWanted;
  }));
  CHECK(service.bytes_served() == 10 * kWanted);
  CHECK(std::ranges::count_if(server.messages, [](const Message& m) {
          return m.type == MessageType::kBlockRequest;
        }) == kWanted);
}

TEST_CASE("A client that requests too many blocks at once gets an error") {
  Network network{Security()};
  for (int i = 0; i < 2; ++i) {
    End& client = network.ConnectTo({});
    REQUIRE(network.Run([&] { return client.connection != nullptr; }));
  }
  REQUIRE(network.Run([&] { return network.accepted.size() == 2; }));
  const ConnectionPtr greedy = network.accepted[0]->connection, other = network.accepted[1]->connection;
  HeldSource held;
  const Catalog catalog = test::CatalogOf(kMostBlockRequests / 2, 10);
  BlockService service(held, catalog);
  for (uint32_t b = 0; b < kMostBlockRequests; ++b) REQUIRE(service.Answer(greedy, Request(b)).has_value());
  const Status status = service.Answer(greedy, Request(7));
  REQUIRE_FALSE(status.has_value());
  CHECK_THAT(status.error().message, Catch::Contains("more than 1024 blocks"));
  CHECK(service.Answer(other, Request(7)).has_value());
  held.AnswerOne();
  CHECK(service.Answer(greedy, Request(7)).has_value());
  CHECK_FALSE(service.Answer(greedy, Request(7)).has_value());
}

TEST_CASE("A destroyed listener is not used by earlier events") {
  asio::io_context io;
  std::unique_ptr<Listener> listener;
  int connections = 0;
  const auto open = [&] {
    auto opened = Listener::Open(io, {"127.0.0.1", 0}, {}, [&](ConnectionPtr) {
      ++connections;
      listener.reset();  // by its own callback
    });
    REQUIRE(opened.has_value());
    listener = std::move(*opened);
  };
  open();
  const tcp::endpoint address(asio::ip::address_v4::loopback(), listener->port());
  tcp::socket first(io), second(io);
  first.connect(address);
  second.connect(address);
  io.run_for(std::chrono::milliseconds(200));
  CHECK(connections == 1);
  // By another handler, when its own are due already: its watch, and a connection.
  open();
  Timer timer(io);
  timer.Set(0.2, [&] { listener.reset(); });
  tcp::socket third(io);
  third.connect({asio::ip::address_v4::loopback(), listener->port()});
  connections = 100;  // the accepting callback would come first
  std::this_thread::sleep_for(std::chrono::milliseconds(1200));
  io.restart();
  io.run_for(std::chrono::milliseconds(200));
  CHECK_FALSE(listener);
}

TEST_CASE("An expired timer that is destroyed, stopped or restarted does not call") {
  asio::io_context io;
  Timer first(io), stopped(io), anew(io);
  std::optional<Timer> destroyed(std::in_place, io);
  std::string calls;
  first.Set(0.01, [&] {
    calls += "first ";
    destroyed.reset();
    stopped.Stop();
    anew.Set(0.01, [&] { calls += "anew "; });
  });
  destroyed->Set(0.02, [&] { calls += "destroyed "; });
  stopped.Set(0.02, [&] { calls += "stopped "; });
  anew.Set(0.02, [&] { calls += "old "; });
  std::this_thread::sleep_for(std::chrono::milliseconds(60));  // all are due
  io.run();
  CHECK(calls == "first anew ");
}

TEST_CASE("Beyond loopback a listener needs a secret") {
  asio::io_context io;
  const auto plain = Listener::Open(io, {"0.0.0.0", 0}, {}, [](const ConnectionPtr&) {});
  REQUIRE_FALSE(plain.has_value());
  CHECK(plain.error().exit_status() == 2);
  CHECK_THAT(plain.error().message, Catch::Contains("--secret-file"));
  CHECK(Listener::Open(io, {"0.0.0.0", 0}, WithSecret('a', true), [](const ConnectionPtr&) {}).has_value());
}

}  // namespace quarry
