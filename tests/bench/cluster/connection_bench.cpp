// The cost of TLS: blocks requested and answered over one loopback connection, as between a worker and a
// voxel server, and connections made one after another, both plain and with a shared secret. Each side has a
// thread of its own.

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "common/base/log.h"
#include "common/net/connection.h"
#include "common/program/run_program.h"
#include "common/protocol/messages.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/median.h"
#include "tests/bench/stopwatch.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace quarry::bench {
namespace {

using ConnectionPtr = std::shared_ptr<Connection>;

constexpr int kRepetitions = 5;
constexpr size_t kWindow = 64;  // requests on the way
constexpr int kConnections = 200;

/// Answers each greeting with a Welcome and each request with the same block, on a thread of its own.
class BlockServer {
 public:
  BlockServer(const Security& security, size_t block_bytes) : block_(block_bytes, std::byte{42}) {
    auto opened = Listener::Open(io_, {"127.0.0.1", 0}, security, [this](ConnectionPtr c) { Serve(c); });
    if (!opened) throw std::runtime_error(opened.error().message);
    listener_ = std::move(*opened);
    port_ = listener_->port();
    thread_ = std::thread([this] { io_.run(); });
  }
  ~BlockServer() {
    io_.stop();
    thread_.join();
  }
  uint16_t port() const { return port_; }

 private:
  void Serve(const ConnectionPtr& c) {
    connections_.insert(c);
    Connection* connection = c.get();
    c->Start(
        [this, connection](const Message& m) {
          if (m.type == MessageType::kHello)
            return connection->Send(MakeMessage(MessageType::kWelcome, Welcome{}));
          connection->Send({MessageType::kBlock, m.request, {}, block_});
        },
        [this, c](const Error&) { connections_.erase(c); });
  }
  boost::asio::io_context io_;
  Bytes block_;
  std::set<ConnectionPtr> connections_;
  std::unique_ptr<Listener> listener_;
  uint16_t port_ = 0;
  std::thread thread_;
};

/// Connects, calls `on_message` with each message after its greeting, until that returns false.
void Converse(uint16_t port, const Security& security,
              std::function<bool(Connection&, const Message&)> on_message) {
  boost::asio::io_context io;
  ConnectionPtr connection;
  Connect(io, {"127.0.0.1", port}, security, [&](Result<ConnectionPtr> c) {
    if (!c) throw std::runtime_error(c.error().message);
    connection = *c;
    connection->Start(
        [&](const Message& m) {
          if (!on_message(*connection, m)) connection->Close();
        },
        [](const Error& e) { throw std::runtime_error(e.message); });
    connection->Send(MakeMessage(MessageType::kHello, Hello{Role::kVoxels, "bench", 0}));
  });
  io.run();
}

struct Figures {
  std::vector<double> bytes_per_s, cpu_s_per_gigabyte, connect_s;
};

Figures Measure(const Security& server_security, const Security& client_security, size_t block_bytes,
                size_t total) {
  Figures figures;
  BlockServer server(server_security, block_bytes);
  const size_t blocks = total / block_bytes;
  for (int run = 0; run < kRepetitions; ++run) {
    size_t asked = 0, received = 0;
    double cpu = 0;
    Clock::time_point start;
    Converse(server.port(), client_security, [&](Connection& c, const Message& m) {
      const auto ask = [&] { c.Send(MakeMessage(MessageType::kBlockRequest, BlockRequest{0}, ++asked)); };
      if (m.type == MessageType::kWelcome) {
        start = Clock::now();
        cpu = ProcessSeconds();
        while (asked < std::min(kWindow, blocks)) ask();
        return true;
      }
      if (asked < blocks) ask();
      if (++received < blocks) return true;
      const double bytes = static_cast<double>(blocks * block_bytes);
      figures.bytes_per_s.push_back(bytes / SecondsSince(start));
      figures.cpu_s_per_gigabyte.push_back((ProcessSeconds() - cpu) / (bytes / 1e9));
      return false;
    });
  }
  for (int i = 0; i < kConnections; ++i) {
    const auto start = Clock::now();
    Converse(server.port(), client_security, [&](Connection&, const Message&) {
      figures.connect_s.push_back(SecondsSince(start));
      return false;
    });
  }
  return figures;
}

nlohmann::ordered_json Report(const char* name, const Figures& f) {
  const auto [low, high] = std::ranges::minmax(f.bytes_per_s);
  Print(fmt::format(
      "{}: {:.0f} MB/s (median of {}, {:.0f} to {:.0f}), {:.2f} s of processor a GB, {:.2f} ms from "
      "connecting to "
      "being greeted (median of {})\n",
      name, Median(f.bytes_per_s) / 1e6, kRepetitions, low / 1e6, high / 1e6, Median(f.cpu_s_per_gigabyte),
      Median(f.connect_s) * 1e3, kConnections));
  return {{"name", name},
          {"bytes_per_s", Median(f.bytes_per_s)},
          {"cpu_s_per_gigabyte", Median(f.cpu_s_per_gigabyte)},
          {"connect_s", Median(f.connect_s)}};
}

int Main(int argc, char** argv) {
  CLI::App app{"What TLS costs a connection on loopback."};
  size_t block_bytes = 256 << 10, total = 1 << 30;
  std::string json;
  app.add_option("--block", block_bytes, "Bytes of a block")
      ->check(CLI::Range(1, 64 << 20))
      ->capture_default_str();
  app.add_option("--total", total, "Bytes to fetch in each of five runs")->capture_default_str();
  app.add_option("--json", json, "Write the figures to this file")->check(bench::CheckFigures);
  if (const auto status = ReadArguments(app, argc, argv)) return *status;

  char path[] = "/tmp/quarry-bench-secret-XXXXXX";
  const int fd = ::mkstemp(path);
  const bool written = fd >= 0 && ::write(fd, "a secret for this benchmark only", 32) == 32;
  const SecurityOptions options{path, {}, {}, {}};
  const auto server = Security::ForServer(options), client = Security::ForClient(options);
  ::close(fd);
  ::unlink(path);
  if (!written || !server || !client) {
    Log(fmt::format("cannot make a secret: {}", server ? "disk" : server.error().message));
    return 1;
  }
  nlohmann::ordered_json results;
  results.push_back(Report("plain", Measure({}, {}, block_bytes, total)));
  results.push_back(Report("shared secret", Measure(*server, *client, block_bytes, total)));
  return bench::WriteFigures(json, results.dump(2)) ? 0 : 1;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench connection", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}
