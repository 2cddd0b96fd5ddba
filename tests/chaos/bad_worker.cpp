// A worker that is mute or lies: the real worker, with this program between it and its master, which holds
// back or forges the worker's messages. Usage:
// quarry-test-bad-worker mute|lie quarry-worker --master HOST:PORT [--secret-file F] ...
// mute: tiles are never answered; all else passes. lie: a thousand threads, every block of the scene held and
// touched, impossible counters and costs, results twice and under leases that do not exist. Pixels stay
// right: a worker that has the secret is trusted with pixels. The program ends with the worker.
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <utility>

#include "common/net/connection.h"
#include "common/protocol/messages.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using ConnectionPtr = std::shared_ptr<Connection>;

constexpr uint64_t kHuge = std::numeric_limits<uint64_t>::max();

class BadWorker {
 public:
  BadWorker(bool lies, std::vector<std::string> command)
      : lies_(lies), command_(std::move(command)), timer_(io_) {}

  int Run() {
    SecurityOptions options;
    for (size_t i = 0; i + 1 < command_.size(); ++i)
      if (command_[i] == "--secret-file") options.secret_file = command_[i + 1];
    auto own = Security::ForServer(options), towards = Security::ForClient(options);
    size_t at = 0;
    while (at + 1 < command_.size() && command_[at] != "--master") ++at;
    if (!own || !towards || at + 1 >= command_.size()) return 2;
    const auto master = ParseEndpoint(command_[at + 1], "--master");
    if (!master) return 2;
    auto listener = Listener::Open(io_, {"127.0.0.1", 0}, *own,
                                   [&](const ConnectionPtr& worker) { Join(worker, *master, *towards); });
    if (!listener) return 2;
    command_[at + 1] = fmt::format("127.0.0.1:{}", (*listener)->port());
    Spawn();
    Watch();
    io_.run();
    return status_;
  }

 private:
  void Spawn() {
    ::setenv("QUARRY_PARENT", std::to_string(::getpid()).c_str(), 1);
    std::vector<char*> arguments;
    for (std::string& part : command_) arguments.push_back(part.data());
    arguments.push_back(nullptr);
    if (::posix_spawn(&child_, arguments[0], nullptr, nullptr, arguments.data(), environ) != 0) std::exit(2);
  }

  void Watch() {
    int status = 0;
    if (::waitpid(child_, &status, WNOHANG) == child_) {
      status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 1;
      return io_.stop();
    }
    timer_.expires_after(std::chrono::milliseconds(50));
    timer_.async_wait([this](const boost::system::error_code&) { Watch(); });
  }

  /// The worker has come; on to its master.
  void Join(const ConnectionPtr& worker, const Endpoint& master, const Security& security) {
    Connect(io_, master, security, [this, worker](Result<ConnectionPtr> result) {
      if (!result) return worker->Close();
      const ConnectionPtr up = *result;
      worker->Start([this, up](Message m) { FromWorker(up, std::move(m)); },
                    [up](const Error&) { up->Close(); });
      up->Start([this, worker](Message m) { FromMaster(worker, std::move(m)); },
                [worker](const Error&) { worker->Close(); });
    });
  }

  void FromMaster(const ConnectionPtr& worker, Message m) {
    if (m.type == MessageType::kCatalog) {
      const auto sections = UnpackSections(m.raw);
      const auto catalog = sections ? DecodeCatalog(SceneId{}, *sections) : Fail("none");
      if (catalog) blocks_ = static_cast<uint32_t>(2 * catalog->voxels.size());
    }
    worker->Send(std::move(m));
  }

  void FromWorker(const ConnectionPtr& master, Message m) {
    if (!lies_) {
      if (m.type != MessageType::kTileDone) master->Send(std::move(m));
      return;
    }
    if (m.type == MessageType::kHello) {
      auto hello = *DecodeHello(m.table);
      hello.threads = 1000;
      m.table = Encode(hello);
    }
    if (m.type == MessageType::kWorkerStatus) m.table = Encode(Forged(*DecodeWorkerStatus(m.table)));
    if (m.type == MessageType::kTileDone) {
      TileDone done = *DecodeTileDone(m.table);
      done.compute_us = done.rays = done.rays_suspended = kHuge;
      done.blocks = All();
      std::fill(done.depths.begin(), done.depths.end(), std::numeric_limits<float>::infinity());
      m.table = Encode(done);
      ++done.lease;
      Message other = m;
      other.table = Encode(done);
      master->Send(std::move(other));
      master->Send(m);
    }
    master->Send(std::move(m));
  }

  std::vector<uint32_t> All() const {
    std::vector<uint32_t> all(blocks_);
    std::iota(all.begin(), all.end(), 0u);
    return all;
  }

  WorkerStatus Forged(WorkerStatus alive) const {
    alive.cached = All();
    alive.dropped.clear();
    alive.cache_bytes = alive.voxels_loaded = alive.voxel_bytes_loaded = alive.voxel_bytes_received = kHuge;
    alive.rays = alive.rays_suspended = alive.peak_rss_bytes = alive.retries = kHuge;
    alive.fetch_us = alive.decode_us = alive.compute_us = alive.stall_us = kHuge;
    alive.tiles_wanted = std::numeric_limits<uint32_t>::max();
    return alive;
  }

  const bool lies_;
  std::vector<std::string> command_;
  asio::io_context io_;
  asio::steady_timer timer_;
  pid_t child_ = 0;
  int status_ = 1;
  uint32_t blocks_ = 0;  ///< of the scene
};

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  const std::string kind = argc > 2 ? argv[1] : "";
  if (kind != "mute" && kind != "lie") {
    fmt::print(stderr, "usage: quarry-test-bad-worker mute|lie quarry-worker --master HOST:PORT ...\n");
    return 2;
  }
  return quarry::BadWorker(kind == "lie", {argv + 2, argv + argc}).Run();
}
