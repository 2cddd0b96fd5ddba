// The cost of sources of blocks on one machine: the store's file, Quarry's own server, a web server
// (nginx) with and without TLS, and a disk cache, empty and full. All blocks of a store are fetched, 16 in
// flight as by a worker's loader; then one at a time.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "common/base/log.h"
#include "common/engine/scene.h"
#include "common/program/run_program.h"
#include "deploy/command/cluster.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/median.h"
#include "tests/bench/stopwatch.h"
#include "tests/support/servers/nginx.h"
#include "tests/support/temporary_folder.h"
#include "worker/sources/disk_cache.h"
#include "worker/sources/http_source.h"
#include "worker/sources/tcp_source.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace quarry::bench {
namespace {

namespace asio = boost::asio;

constexpr int kRepetitions = 7;
constexpr uint32_t kInFlight = 16;
constexpr size_t kAlone = 500;  // blocks fetched one at a time

/// Fetches a list of blocks, a number of them in flight, and checks each block that arrives.
class Fetching {
 public:
  Fetching(asio::io_context& io, VoxelSource& source, const Catalog& catalog, std::vector<BlockKey> blocks)
      : io_(io), source_(source), catalog_(catalog), blocks_(std::move(blocks)) {}

  Status Run(uint32_t in_flight) {
    next_ = done_ = 0;
    status_ = {};
    io_.restart();
    for (uint32_t i = 0; i < in_flight; ++i) asio::post(io_, [this] { Next(); });
    // Sources keep timers and connections of their own: the end is counted, not waited for.
    while (done_ < blocks_.size() && status_) io_.run_one();
    return status_;
  }

 private:
  void Next() {
    if (next_ == blocks_.size()) return;
    const BlockKey block = blocks_[next_++];
    source_.Fetch(block, [this, block](Result<Bytes> bytes) {
      const BlockEntry& entry = catalog_.block(block);
      if (!bytes)
        status_ = tl::unexpected<Error>(bytes.error());
      else if (bytes->size() != entry.stored || Checksum(*bytes) != entry.checksum)
        status_ = Fail(fmt::format("block {} is not the store's", catalog_.NumberOf(block)));
      ++done_;
      asio::post(io_, [this] { Next(); });
    });
  }

  asio::io_context& io_;
  VoxelSource& source_;
  const Catalog& catalog_;
  std::vector<BlockKey> blocks_;
  size_t next_ = 0, done_ = 0;
  Status status_;
};

struct Figures {
  std::string name;
  double seconds = 0, slowest_s = 0, fastest_s = 0, cpu_s = 0, alone_s = 0;
};

class SourcesBench {
 public:
  explicit SourcesBench(const StoreReader& store) : store_(store), catalog_(store.catalog()) {
    for (uint32_t number = 0; number < catalog_.block_numbers(); ++number) {
      const std::optional<BlockKey> block = catalog_.BlockOf(number);
      if (!block) continue;
      blocks_.push_back(*block);
      bytes_ += catalog_.block(*block).stored;
    }
  }

  using Make = std::function<std::unique_ptr<VoxelSource>(asio::io_context&)>;

  /// One source for all repetitions; or one for each, made and ended outside the time that counts, where
  /// `before` is given and called before.
  Status Measure(const std::string& name, const Make& make, const std::function<void()>& before = {}) {
    asio::io_context io;
    std::unique_ptr<VoxelSource> source;
    std::vector<double> times, cpu, alone;
    for (int i = 0; i < kRepetitions; ++i) {
      if (before) {
        source.reset();
        before();
      }
      if (!source) source = make(io);
      Fetching all(io, *source, catalog_, blocks_);
      const double cpu_before = ProcessSeconds();
      const auto begin = Clock::now();
      QUARRY_TRY(all.Run(kInFlight));
      times.push_back(SecondsSince(begin));
      cpu.push_back(ProcessSeconds() - cpu_before);
      if (before) continue;
      std::vector<BlockKey> some = blocks_;
      some.resize(std::min(kAlone, some.size()));
      Fetching one(io, *source, catalog_, some);
      const auto begin_alone = Clock::now();
      QUARRY_TRY(one.Run(1));
      alone.push_back(SecondsSince(begin_alone) / static_cast<double>(some.size()));
    }
    figures_.push_back({name, Median(times), *std::ranges::max_element(times),
                        *std::ranges::min_element(times), Median(cpu), alone.empty() ? 0 : Median(alone)});
    return {};
  }

  std::unique_ptr<VoxelSource> FromFile(asio::io_context& io) const {
    return Scene::Open(store_.path())->MakeSource([&io](std::function<void()> task) {
      asio::post(io, std::move(task));
    });
  }

  Status Run() {
    const test::TemporaryFolder folder;
    QUARRY_TRY(Measure("file", [&](asio::io_context& io) { return FromFile(io); }));
    QUARRY_TRY(MeasureCache("disk cache, file", folder.file("cache"),
                            [&](asio::io_context& io) { return FromFile(io); }));
    LocalCluster::Options options;
    options.scene = store_.path();
    options.workers = 0;
    options.threads = 1;
    QUARRY_ASSIGN(const auto cluster, LocalCluster::Start(options));
    QUARRY_TRY(Measure("tcp", [&](asio::io_context& io) {
      return std::make_unique<TcpVoxelSource>(io, cluster->master(), Security(), catalog_);
    }));
    if (!test::Nginx::Program().empty()) return MeasureNginx(folder);
    Print("nginx is not installed: http is left out\n");
    return {};
  }

  void PrintTable() const {
    const auto blocks = static_cast<double>(blocks_.size()), bytes = static_cast<double>(bytes_);
    Print(fmt::format(
        "{}: {} blocks, {:.1f} MB, {:.1f} KB a block; {} in flight; median of {} (fastest, slowest)\n",
        std::filesystem::path(store_.path()).filename().string(), blocks_.size(), bytes / 1e6,
        bytes / blocks / 1e3, kInFlight, kRepetitions));
    Print(fmt::format("{:26} {:>10} {:>8} {:>18} {:>14} {:>12}\n", "source", "blocks/s", "MB/s", "",
                      "CPU us/block", "alone, us"));
    for (const Figures& f : figures_)
      Print(fmt::format("{:26} {:10.0f} {:8.0f} {:>18} {:14.1f} {:>12}\n", f.name, blocks / f.seconds,
                        bytes / f.seconds / 1e6,
                        fmt::format("({:.0f}, {:.0f})", bytes / f.fastest_s / 1e6, bytes / f.slowest_s / 1e6),
                        f.cpu_s / blocks * 1e6, f.alone_s > 0 ? fmt::format("{:.0f}", f.alone_s * 1e6) : ""));
  }

  nlohmann::ordered_json Json() const {
    nlohmann::ordered_json results = nlohmann::ordered_json::array();
    for (const Figures& f : figures_)
      results.push_back({{"source", f.name},
                         {"blocks", blocks_.size()},
                         {"stored_bytes", bytes_},
                         {"wall_s", f.seconds},
                         {"fastest_wall_s", f.fastest_s},
                         {"slowest_wall_s", f.slowest_s},
                         {"cpu_s", f.cpu_s},
                         {"alone_s", f.alone_s}});
    return results;
  }

 private:
  Status MeasureCache(const std::string& name, const std::string& folder, const Make& make) {
    const auto cached = [&, folder](asio::io_context& io) {
      return std::make_unique<DiskCachedSource>(
          io, make(io), DiskCacheLocation{folder, uint64_t{1} << 40}, catalog_,
          [](const std::string& line) { Print(fmt::format("{}\n", line)); });
    };
    QUARRY_TRY(Measure(name + ", empty", cached, [&] { std::filesystem::remove_all(folder); }));
    // The one before may have left out blocks that its disk was too slow for.
    for (int i = 0; i < 3; ++i) {
      asio::io_context io;
      const auto source = cached(io);
      QUARRY_TRY(Fetching(io, *source, catalog_, blocks_).Run(1));
    }
    return Measure(name + ", full", cached);
  }

  Status MeasureNginx(const test::TemporaryFolder& folder) {
    const auto path = std::filesystem::absolute(store_.path());
    const auto url = [&](const char* scheme, uint16_t port) {
      return ParseHttpLocation(fmt::format("{}://localhost:{}/{}", scheme, port, path.filename().string()),
                               "address");
    };
    QUARRY_ASSIGN(const auto plain, test::Nginx::Start(folder.file("nginx"), path.parent_path().string()));
    QUARRY_ASSIGN(const HttpLocation http, url("http", plain->port()));
    const auto by_http = [&](asio::io_context& io) {
      return std::make_unique<HttpVoxelSource>(io, http, catalog_, HttpOptions());
    };
    QUARRY_TRY(Measure("http, nginx", by_http));
    HttpOptions signing;
    signing.aws = AwsCredentials{"eu-central-1", "KEY", "SECRET", ""};
    QUARRY_TRY(Measure("http, nginx, signed", [&](asio::io_context& io) {
      return std::make_unique<HttpVoxelSource>(io, http, catalog_, signing);
    }));
    QUARRY_TRY(MeasureCache("disk cache, http", folder.file("cache"), by_http));
    const std::string make = fmt::format(
        "cd {} && openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -addext "
        "subjectAltName=DNS:localhost -keyout k -out c 2>/dev/null && cat c k > pem",
        folder.path());
    if (std::system(make.c_str()) != 0) return Fail("openssl makes no certificate");
    QUARRY_ASSIGN(const auto secure, test::Nginx::Start(folder.file("nginx-tls"), path.parent_path().string(),
                                                        "", folder.file("pem")));
    QUARRY_ASSIGN(const HttpLocation https, url("https", secure->port()));
    HttpOptions options;
    options.tls_ca = folder.file("c");
    return Measure("https, nginx", [&](asio::io_context& io) {
      return std::make_unique<HttpVoxelSource>(io, https, catalog_, options);
    });
  }

  const StoreReader& store_;
  const Catalog& catalog_;
  std::vector<BlockKey> blocks_;
  uint64_t bytes_ = 0;
  std::vector<Figures> figures_;
};

int Main(int argc, char** argv) {
  std::string path, json;
  CLI::App app("What ways of having blocks cost: file, tcp, http, https, disk cache.");
  app.add_option("store", path, "A store made by quarry-preprocess")->required();
  app.add_option("--json", json, "Results as JSON")->check(bench::CheckFigures);
  if (const auto status = ReadArguments(app, argc, argv)) return *status;
  const auto store = StoreReader::Open(path);
  std::optional<SourcesBench> bench;
  if (store) bench.emplace(*store);
  const Status status = bench ? bench->Run() : Status(Fail(store.error().message));
  if (bench) bench->PrintTable();
  if (!status) {
    Log(fmt::format("quarry-bench-sources: {}", status.error().message));
    return 1;
  }
  return bench::WriteFigures(json, bench->Json().dump(2)) ? 0 : 1;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench sources", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}
