#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <catch2/catch.hpp>
#include <chrono>
#include <deque>

#include "common/base/resource.h"
#include "common/net/stream_connection.h"
#include "common/protocol/messages.h"
#include "master/block_service.h"
#include "tests/support/cluster/shared_tables.h"
#include "tests/support/stores/voxel_blocks.h"
#include "worker/sources/tcp_source.h"

// Limits of a listening program on strangers: bytes, connections and time.

namespace quarry {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using test::SharedCameras, test::SharedSources;

/// A listener, its connections and the count of their messages.
struct Server {
  explicit Server(ListenerOptions options = {}) {
    listener = std::move(*Listener::Open(
        io, {"127.0.0.1", 0}, {}, [this](auto c) { On(c); }, options));
  }
  void On(const std::shared_ptr<Connection>& c) {
    connections.push_back(c);
    closed.emplace_back();
    const size_t n = connections.size() - 1;
    c->Start(
        [this, n](const Message&) {
          ++messages;
          connections[n]->Expect(speaker);
        },
        [this, n](const Error& e) { closed[n] = e.message; });
  }
  AcceptedConnection& at(size_t n) { return dynamic_cast<AcceptedConnection&>(*connections[n]); }
  template <class Done>
  bool Run(Done done) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!done() && std::chrono::steady_clock::now() < end) {
      io.restart();
      io.run_for(std::chrono::milliseconds(1));
    }
    return done();
  }
  /// A plain socket whose preamble, and greeting, are sent.
  tcp::socket& Stranger(bool greet = true) {
    peers.emplace_back(peer_io);
    peers.back().connect({asio::ip::make_address("127.0.0.1"), listener->port()});
    asio::write(peers.back(), asio::buffer(EncodePreamble()));
    const size_t before = messages;
    const Message hello = MakeMessage(MessageType::kHello, Hello{Role::kVoxels, "x", 0});
    if (greet) Say(hello, hello.table.size());
    const size_t count = peers.size();
    REQUIRE(Run([&] { return connections.size() == count && (!greet || messages > before); }));
    return peers.back();
  }
  /// Its header and so many bytes of it.
  void Say(const Message& m, size_t bytes) {
    asio::write(peers.back(), asio::buffer(EncodeFrameHeader(m)));
    asio::write(peers.back(), asio::buffer(m.table.data(), bytes));
  }

  asio::io_context io, peer_io;
  std::unique_ptr<Listener> listener;
  std::vector<std::shared_ptr<Connection>> connections;
  std::vector<std::string> closed;
  std::deque<tcp::socket> peers;
  Speaker speaker = Speaker::kClient;
  size_t messages = 0;
};

}  // namespace

TEST_CASE("Tables that share their parts are refused before they are unpacked", "[strangers]") {
  const uint64_t before = PeakResidentBytes();
  // 0.2 MB that unpacked would be 1.2 GB; then cameras that are right, but one.
  for (const size_t doubles : {size_t{15000}, size_t{3}}) {
    const auto request = DecodeJobRequest(SharedCameras(10000, doubles));
    REQUIRE_FALSE(request.has_value());
    CHECK_THAT(request.error().message, Catch::Contains("not well formed"));
  }
  CHECK(DecodeJobRequest(SharedCameras(1, 3)).has_value());
  CHECK_FALSE(DecodeWelcome(SharedSources(10000, 60000)).has_value());
  CHECK(DecodeWelcome(SharedSources(1, 60000)).has_value());
  CHECK(PeakResidentBytes() - before < 16 << 20);
}

TEST_CASE("Messages that lack their tables are refused", "[strangers]") {
  flatbuffers::FlatBufferBuilder b;
  const auto start = b.StartTable();
  b.Finish(flatbuffers::Offset<flatbuffers::Table>(b.EndTable(start)));
  const Bytes empty = test::TakeBytes(b);
  const auto frame = DecodeFrameSetup(empty);
  REQUIRE_FALSE(frame.has_value());
  CHECK_THAT(frame.error().message, Catch::Contains("a frame without a view"));
  const auto job = DecodeJobRequest(empty);
  REQUIRE_FALSE(job.has_value());
  CHECK_THAT(job.error().message, Catch::Contains("a request without a job"));
}

TEST_CASE("Each kind of speaker may send its own messages only, and no larger ones", "[strangers]") {
  const auto takes = [](Speaker speaker, MessageType type, size_t table, size_t raw) {
    return DecodeFrameHeader(EncodeFrameHeader({type, 1, Bytes(table), Bytes(raw)}), speaker).has_value();
  };
  CHECK(takes(Speaker::kStranger, MessageType::kHello, 1000, 0));
  CHECK_FALSE(takes(Speaker::kStranger, MessageType::kHello, 2000, 0));
  CHECK_FALSE(takes(Speaker::kStranger, MessageType::kRenderJob, 10, 0));
  CHECK_FALSE(takes(Speaker::kStranger, MessageType::kPing, 0, 0));
  CHECK(takes(Speaker::kVoxels, MessageType::kBlockRequest, 100, 0));
  CHECK_FALSE(takes(Speaker::kVoxels, MessageType::kBlockRequest, 2000, 0));
  CHECK_FALSE(takes(Speaker::kVoxels, MessageType::kRenderJob, 100, 0));
  CHECK_FALSE(takes(Speaker::kVoxels, MessageType::kFrameDone, 0, 100));
  CHECK(takes(Speaker::kClient, MessageType::kRenderJob, 10 << 20, 0));
  CHECK_FALSE(takes(Speaker::kClient, MessageType::kRenderJob, 11 << 20, 0));
  CHECK_FALSE(takes(Speaker::kClient, MessageType::kTileDone, 100, 100));
  CHECK(takes(Speaker::kWorker, MessageType::kTileDone, 100, 52 << 10));
  CHECK_FALSE(takes(Speaker::kWorker, MessageType::kTileDone, 100, 257 << 10));
  CHECK(takes(Speaker::kWorker, MessageType::kRayDone, 100, 0));
  CHECK_FALSE(takes(Speaker::kWorker, MessageType::kRay, 100, 0));
  CHECK(takes(Speaker::kMasterOfWorkers, MessageType::kRay, 100, 0));
  CHECK_FALSE(takes(Speaker::kMasterOfWorkers, MessageType::kRay, 2000, 0));
  CHECK_FALSE(takes(Speaker::kMasterOfClients, MessageType::kRayDone, 100, 0));
  CHECK_FALSE(takes(Speaker::kVoxelServer, MessageType::kCatalog, 0, 100));
  CHECK_FALSE(takes(Speaker::kMasterOfClients, MessageType::kCatalog, 0, 100));
  // The largest job there may be.
  RenderJob job;
  job.cameras.assign(kMaxFrames, CameraSpec{{0.5, -1, 0.25}, {1, 2, 3}, {0, 0, 1}, 33, 2});
  REQUIRE(NormalizeJob(job).has_value());
  const Message m = MakeMessage(MessageType::kRenderJob, JobRequest{job, 0});
  CHECK(DecodeFrameHeader(EncodeFrameHeader(m), Speaker::kClient).has_value());
  CHECK(DecodeJobRequest(m.table)->job.cameras.size() == kMaxFrames);
}

TEST_CASE("A claimed size costs nothing, and all bytes received of unfinished messages are bounded",
          "[strangers]") {
  ListenerOptions options;
  options.incoming_bytes = 4 << 20;
  Server server(options);
  const uint64_t before = PeakResidentBytes();
  const Message job{MessageType::kRenderJob, 1, Bytes(9 << 20), {}};
  for (int i = 0; i < 40; ++i) {
    server.Stranger();
    server.Say(job, 100);
  }
  CHECK(server.Run([&] { return server.messages == 40; }));
  CHECK(PeakResidentBytes() - before < (14 << 20));  // the message itself, here, and forty beginnings
  // Now they send on: the bytes received stay below the listener's limit, and small messages get in.
  for (size_t i = 0; i < 40; ++i) {
    tcp::socket& peer = server.peers[i];
    peer.non_blocking(true);
    for (size_t sent = 100; sent < 1 << 20;) {
      boost::system::error_code error;
      sent += peer.write_some(asio::buffer(job.table.data(), (1 << 20) - sent), error);
      server.io.restart();
      server.io.poll();
      if (error && error != asio::error::would_block) break;
    }
  }
  server.Stranger();
  CHECK(std::ranges::count_if(server.closed, [](const std::string& why) {
          return why.find("incomplete messages") != std::string::npos;
        }) > 20);
  CHECK(PeakResidentBytes() - before < (24 << 20));
}

TEST_CASE("Half a message, silence, and a peer that does not read have time limits", "[strangers]") {
  Server server;
  server.speaker = Speaker::kClient;
  using std::chrono::seconds;
  server.Stranger();
  server.Say({MessageType::kRenderJob, 1, Bytes(64 << 10), {}}, 100);
  server.Stranger();  // silent
  server.Stranger();
  REQUIRE(server.Run([&] { return server.at(0).received_bytes() > 140; }));
  for (int i = 0; i < 20; ++i) server.connections[2]->Send({MessageType::kBlock, 1, {}, Bytes(1 << 20)});
  server.io.restart();
  server.io.run_for(std::chrono::milliseconds(100));
  const auto now = AcceptedConnection::Clock::now();
  const auto look = [&](int s) {
    for (size_t i = 0; i < 3; ++i)
      if (server.closed[i].empty()) server.at(i).Watch(now + seconds(s));
  };
  for (int s = 0; s < 10; ++s) look(s);
  CHECK(server.closed == std::vector<std::string>(3));
  look(12);
  CHECK_THAT(server.closed[2], Catch::Contains("does not read"));
  look(29);
  CHECK(server.closed[0].empty());
  look(40);
  CHECK_THAT(server.closed[0], Catch::Contains("incomplete for too long"));
  CHECK(server.closed[1].empty());
  look(62);
  CHECK_THAT(server.closed[1], Catch::Contains("idle for 60 seconds"));
}

TEST_CASE("A listener at its limit of connections drops idle ones for new ones", "[strangers]") {
  std::vector<std::string> log;
  ListenerOptions options;
  options.most_connections = 8;
  options.log = [&](const std::string& line) { log.push_back(line); };
  Server server(options);
  server.speaker = Speaker::kClient;
  server.Stranger();  // a peer that fetches no blocks stays while it is not silent
  server.speaker = Speaker::kVoxels;
  for (int i = 0; i < 20; ++i) server.Stranger();
  const auto open = std::ranges::count(server.closed, std::string());
  CHECK(open == 8);
  CHECK(server.closed[0].empty());
  CHECK(server.closed.back().empty());
  REQUIRE(log.size() == 1);
  CHECK_THAT(log[0], Catch::Contains("8 connections"));
}

TEST_CASE("A server that sends more than a block is disconnected", "[strangers]") {
  Server server;
  server.speaker = Speaker::kVoxels;
  asio::io_context io;
  const Catalog catalog = test::CatalogOf(2, 1000);
  TcpVoxelSource source(io, {"127.0.0.1", server.listener->port()}, {}, catalog);
  std::optional<Result<Bytes>> got;
  source.Fetch(3_b, [&](Result<Bytes> r) { got = std::move(r); });
  const auto both = [&](auto done) {
    return server.Run([&] {
      io.restart();
      io.run_for(std::chrono::milliseconds(1));
      return done();
    });
  };
  REQUIRE(both([&] { return server.messages == 1; }));
  server.connections[0]->Send(MakeMessage(MessageType::kWelcome, Welcome{SceneId{}, 0, {}}));
  server.connections[0]->Send({MessageType::kBlock, 1, {}, Bytes(1001)});
  REQUIRE(both([&] { return got.has_value(); }));
  REQUIRE_FALSE(got->has_value());
  CHECK_THAT(got->error().message, Catch::Contains("larger than requested"));
}

namespace {

/// A source that answers at once, and counts its requests.
struct CountingSource final : VoxelSource {
  size_t asked = 0;
  void Fetch(BlockKey, Done done) override {
    ++asked;
    done(Bytes(100 << 10));
  }
};

}  // namespace

TEST_CASE("Blocks are read only as peers take them, and a peer that takes none delays nobody",
          "[strangers]") {
  Server server;
  server.speaker = Speaker::kVoxels;
  CountingSource source;
  constexpr size_t kStrangers = 30, kWanted = 100;
  const Catalog catalog = test::CatalogOf(kWanted / 2, 100 << 10);
  BlockService service(source, catalog);
  for (size_t i = 0; i < kStrangers; ++i) {
    server.Stranger();
    for (uint32_t b = 0; b < kWanted; ++b)
      REQUIRE(
          service
              .Answer(server.connections[i], MakeMessage(MessageType::kBlockRequest, BlockRequest{b}, b + 1))
              .has_value());
  }
  server.io.restart();
  server.io.run_for(std::chrono::milliseconds(300));
  uint64_t queued = 0;
  for (const auto& c : server.connections) queued += c->queued_bytes();
  CHECK(queued <= BlockService::kMostBytes);
  // Nobody reads. A peer that does read gets all its blocks; peers that hold it up are dropped meanwhile.
  tcp::socket& reader = server.Stranger();
  for (uint32_t b = 0; b < kWanted; ++b)
    REQUIRE(service
                .Answer(server.connections.back(),
                        MakeMessage(MessageType::kBlockRequest, BlockRequest{b}, b + 1))
                .has_value());
  reader.non_blocking(true);
  Bytes rest(1 << 20);
  uint64_t read = 0;
  CHECK(server.Run([&] {
    boost::system::error_code error;
    read += reader.read_some(asio::buffer(rest), error);
    for (const auto& c : service.Stalled()) {
      c->Close();
      service.Forget(c);
    }
    return read > kWanted * (100 << 10);
  }));
  CHECK(source.asked < kStrangers * kWanted);
}

}  // namespace quarry
