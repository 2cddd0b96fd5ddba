#include "worker/block_supply.h"

#include <algorithm>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <chrono>

#include "tests/support/stores/cached_store.h"

// Where a worker's blocks come from, over real sockets and files on one thread.

namespace quarry {
namespace {

using namespace std::chrono_literals;
using test::CacheScene;
using test::kPlenty;

/// A supply and its log.
struct Supplied {
  CacheInventory inventory;
  std::vector<std::string> log;
  std::unique_ptr<BlockSupply> supply;

  uint64_t from(SourceKind kind) const { return supply->counters().bytes_from[static_cast<size_t>(kind)]; }
};

/// A scene in a file, and workers' supplies of its blocks.
struct Site {
  explicit Site(uint32_t voxels = 20) : scene(voxels) {}

  std::string File() const { return "file:" + scene.folder.file("s"); }
  SupplyOptions Options(std::vector<std::string> sources) const {
    SupplyOptions options;
    options.sources = std::move(sources);
    options.stored_bytes = kPlenty;
    options.give_up_after_s = 0.5;
    options.idle = [] { return true; };
    return options;
  }
  Status Open(Supplied& to, SupplyOptions options) {
    options.log = [&to](const std::string& line) { to.log.push_back(line); };
    auto opened = BlockSupply::Open(io, scene.catalog(), options, to.inventory);
    if (!opened) return tl::unexpected<Error>(opened.error());
    to.supply = std::move(*opened);
    return {};
  }
  /// A worker that has fetched `blocks`, and serves them.
  std::unique_ptr<Supplied> Serving(const std::vector<BlockKey>& blocks) {
    auto made = std::make_unique<Supplied>();
    REQUIRE(Open(*made, Options({File()})).has_value());
    for (const BlockKey block : blocks) REQUIRE(Fetch(*made, block).has_value());
    CHECK(made->supply->serves_at() == 0);
    REQUIRE(made->supply->Serve({"127.0.0.1", 0}).has_value());
    CHECK(made->supply->serves_at() != 0);
    return made;
  }
  template <class Condition>
  void RunUntil(Condition condition) {
    const auto end = std::chrono::steady_clock::now() + 60s;
    while (!condition() && std::chrono::steady_clock::now() < end) io.run_one_for(10ms);
    REQUIRE(condition());
  }
  Result<Bytes> Fetch(Supplied& from, BlockKey block) {
    std::optional<Result<Bytes>> got;
    from.supply->source().Fetch(block, [&](Result<Bytes> bytes) {
      REQUIRE_FALSE(got);
      got = std::move(bytes);
    });
    RunUntil([&] { return got.has_value(); });
    return std::move(*got);
  }
  void CheckAll(Supplied& from) {
    for (const BlockKey block : scene.blocks) {
      const auto got = Fetch(from, block);
      REQUIRE(got.has_value());
      CHECK(*got == scene.store->ReadBlock(block).value());
    }
  }
  uint64_t StoredBytes() const {
    uint64_t bytes = 0;
    for (const BlockKey block : scene.blocks) bytes += scene.catalog().block(block).stored;
    return bytes;
  }
  /// Says that tile `order` needs all blocks, and that `holder` has them.
  TileOrder NeedsAll(uint32_t holder) const {
    TileOrder order;
    for (const BlockKey block : scene.blocks) {
      order.blocks.push_back(scene.catalog().NumberOf(block));
      order.holders.push_back(holder);
    }
    return order;
  }

  CacheScene scene;
  boost::asio::io_context io;
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> stays{io.get_executor()};
};

std::string At(const Supplied& served) { return fmt::format("127.0.0.1:{}", served.supply->serves_at()); }
constexpr const char* kNobody = "127.0.0.1:1";  ///< nothing listens there

}  // namespace

TEST_CASE("Blocks are fetched from the named source once, and then read from the stored cache", "[supply]") {
  Site site;
  Supplied worker;
  REQUIRE(site.Open(worker, site.Options({site.File()})).has_value());
  site.CheckAll(worker);
  CHECK(worker.from(SourceKind::kFile) == site.StoredBytes());
  CHECK(worker.supply->stored().hit_bytes == 0);
  for (const BlockKey block : site.scene.blocks) CHECK(worker.inventory.Has(block));
  site.CheckAll(worker);
  CHECK(worker.from(SourceKind::kFile) == site.StoredBytes());
  CHECK(worker.supply->stored().hit_bytes == site.StoredBytes());
  CHECK(worker.log.empty());
}

TEST_CASE("A source that cannot be used is refused by its name", "[supply]") {
  Site site;
  test::WriteSmallStore(site.scene.folder.file("other"), 5, 2);
  const std::pair<std::string, std::string> cases[] = {
      {"file:" + site.scene.folder.file("other"), "is another scene than the master's"},
      {"file:" + site.scene.folder.file("none"), "No such file"},
      {"nowhere", "HOST:PORT"},
      {"http://a b/", "http://a b/"}};
  for (const auto& [source, sentence] : cases) {
    Supplied worker;
    const Status status = site.Open(worker, site.Options({site.File(), source}));
    REQUIRE_FALSE(status.has_value());
    CHECK_THAT(status.error().message,
               Catch::StartsWith("--source " + source + ": ") && Catch::Contains(sentence));
  }
}

TEST_CASE("Without named sources, blocks are fetched from the master", "[supply]") {
  Site site;
  const auto master = site.Serving(site.scene.blocks);
  for (const std::vector<std::string>& sources : {std::vector<std::string>{}, {"master"}}) {
    Supplied worker;
    SupplyOptions options = site.Options(sources);
    options.master = {"127.0.0.1", master->supply->serves_at()};
    REQUIRE(site.Open(worker, options).has_value());
    site.CheckAll(worker);
    CHECK(worker.from(SourceKind::kTcp) == site.StoredBytes());
  }
}

TEST_CASE("Servers are tried first, and then workers that are said to hold a block", "[supply]") {
  Site site;
  const auto peer = site.Serving(site.scene.blocks);
  const Peers peers{{7}, {At(*peer)}};
  {
    Supplied worker;
    REQUIRE(site.Open(worker, site.Options({site.File()})).has_value());
    worker.supply->SetPeers(peers);
    worker.supply->Expect(site.NeedsAll(7));
    // The first block: no source's speed is known yet, so only the order counts, unless the file is late.
    REQUIRE(site.Fetch(worker, site.scene.blocks[0]).has_value());
    const SourceSet::Counters& counters = worker.supply->counters();
    if (counters.hedges + counters.retries == 0) CHECK(worker.from(SourceKind::kPeer) == 0);
    // Later ones come from wherever answers are quicker, which on a busy machine may be the worker.
    site.CheckAll(worker);
    CHECK(worker.from(SourceKind::kFile) + worker.from(SourceKind::kPeer) >= site.StoredBytes());
  }
  Supplied worker;
  REQUIRE(site.Open(worker, site.Options({kNobody})).has_value());
  worker.supply->SetPeers(peers);
  worker.supply->Expect(site.NeedsAll(7));
  site.CheckAll(worker);
  CHECK(worker.from(SourceKind::kPeer) == site.StoredBytes());
  CHECK(worker.from(SourceKind::kTcp) == 0);
}

TEST_CASE("A block that no source gives is an error with the source's sentence", "[supply]") {
  Site site;
  const BlockKey block = site.scene.blocks[3];
  const auto peer = site.Serving({site.scene.blocks[0]});
  for (const bool with_peer : {false, true}) {
    Supplied worker;
    REQUIRE(site.Open(worker, site.Options({kNobody})).has_value());
    if (with_peer) {
      worker.supply->SetPeers({{7}, {At(*peer)}});
      worker.supply->Expect(site.NeedsAll(7));  // outdated: it has the first block only
      CHECK(site.Fetch(worker, site.scene.blocks[0]).has_value());
    }
    const auto got = site.Fetch(worker, block);
    REQUIRE_FALSE(got.has_value());
    CHECK_THAT(got.error().message, Catch::Contains(kNobody));
    CHECK_FALSE(worker.inventory.Has(block));
  }
}

TEST_CASE("Workers that are gone get no more requests", "[supply]") {
  Site site;
  const auto peer = site.Serving(site.scene.blocks);
  Supplied worker;
  REQUIRE(site.Open(worker, site.Options({kNobody})).has_value());
  worker.supply->SetPeers({{7}, {At(*peer)}});
  worker.supply->Expect(site.NeedsAll(7));
  CHECK(site.Fetch(worker, site.scene.blocks[0]).has_value());
  worker.supply->SetPeers({});
  CHECK_FALSE(site.Fetch(worker, site.scene.blocks[1]).has_value());
}

TEST_CASE("A worker serves the blocks that it holds, and refuses others at once", "[supply]") {
  Site site;
  const auto server = site.Serving({site.scene.blocks[0], site.scene.blocks[1]});
  Supplied worker;
  SupplyOptions options = site.Options({At(*server)});
  options.give_up_after_s = 3600;
  REQUIRE(site.Open(worker, options).has_value());
  CHECK(site.Fetch(worker, site.scene.blocks[1]).has_value());
  const auto got = site.Fetch(worker, site.scene.blocks[2]);
  REQUIRE_FALSE(got.has_value());
  CHECK_THAT(got.error().message, Catch::Contains("does not have the block"));
  REQUIRE(worker.log.size() == 1);
  CHECK_THAT(worker.log[0], Catch::Contains("refuses"));
}

TEST_CASE("A disk cache keeps fetched blocks for the next worker", "[supply]") {
  Site site;
  SupplyOptions options = site.Options({site.File()});
  options.disk_cache = DiskCacheLocation{site.scene.folder.file("cache"), kPlenty};
  {
    Supplied worker;
    REQUIRE(site.Open(worker, options).has_value());
    site.CheckAll(worker);
    CHECK(worker.supply->bytes_from_disk() == 0);
  }
  options.sources = {kNobody};
  Supplied worker;
  REQUIRE(site.Open(worker, options).has_value());
  site.CheckAll(worker);
  CHECK(worker.supply->bytes_from_disk() == site.StoredBytes());
  CHECK(worker.from(SourceKind::kTcp) == 0);
}

TEST_CASE("Expected blocks are fetched while no others are, a few at once", "[supply]") {
  Site site(60);
  Supplied worker;
  bool idle = false;
  SupplyOptions options = site.Options({site.File()});
  options.idle = [&] { return idle; };
  REQUIRE(site.Open(worker, options).has_value());
  TileOrder order = site.NeedsAll(0);
  order.blocks.insert(order.blocks.begin(), 1u << 30);  // there is no such block
  order.holders.insert(order.holders.begin(), 0);
  worker.supply->Expect(order);
  const auto held = [&] { return worker.inventory.TakeAll().size(); };
  worker.supply->Prefetch();
  CHECK(held() == 0);
  idle = true;
  worker.supply->Prefetch();
  idle = false;  // a ray waits: none is asked for beside those under way
  site.RunUntil([&] { return held() == 4; });
  site.io.run_for(50ms);
  CHECK(held() == 4);
  idle = true;
  worker.supply->Prefetch();
  site.RunUntil([&] { return held() == site.scene.blocks.size(); });
  CHECK(worker.from(SourceKind::kFile) == site.StoredBytes());
  CHECK(worker.supply->stored().prefetched_bytes == site.StoredBytes());
  // They are there when rays come, and not fetched again.
  site.CheckAll(worker);
  worker.supply->Expect(order);
  worker.supply->Prefetch();
  site.io.run_for(50ms);
  CHECK(worker.from(SourceKind::kFile) == site.StoredBytes());
}

TEST_CASE("Expected blocks that are forgotten, or held decoded, are not fetched", "[supply]") {
  Site site;
  Supplied worker;
  REQUIRE(site.Open(worker, site.Options({site.File()})).has_value());
  worker.supply->Expect(site.NeedsAll(0));
  worker.supply->ClearExpected();
  worker.supply->Prefetch();
  site.io.run_for(50ms);
  CHECK(worker.inventory.TakeAll().empty());
  for (const BlockKey block : site.scene.blocks) worker.inventory.Set(block, CacheInventory::kDecoded, true);
  worker.supply->Expect(site.NeedsAll(0));
  worker.supply->Prefetch();
  site.io.run_for(50ms);
  CHECK(worker.from(SourceKind::kFile) == 0);
}

TEST_CASE("HTTP headers are sent only to servers that this worker's owner names", "[supply]") {
  Site site;
  const std::string url = "http://127.0.0.1:1/s";
  for (const bool own : {false, true})
    for (const bool listed : {false, true}) {
      Supplied worker;
      SupplyOptions options = site.Options({url});
      options.http.headers = {{"X-Token", "open sesame"}};
      options.own_sources = own;
      if (listed) options.header_servers = {{"127.0.0.1", 1}};
      REQUIRE(site.Open(worker, options).has_value());
      REQUIRE(worker.log.size() == (own || listed ? 0 : 1));
      for (const std::string& line : worker.log) {
        CHECK_THAT(line, Catch::Contains("gets no headers") && Catch::Contains("127.0.0.1:1"));
        CHECK_THAT(line, !Catch::Contains("sesame"));
      }
    }
}

}  // namespace quarry
