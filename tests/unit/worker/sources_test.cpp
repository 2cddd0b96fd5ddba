#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <catch2/catch.hpp>
#include <deque>
#include <map>
#include <optional>

#include "common/net/source_spec.h"
#include "tests/support/stores/voxel_blocks.h"
#include "worker/sources/source_policy.h"
#include "worker/sources/source_set.h"
#include "worker/sources/stored_cache.h"

namespace quarry {
namespace {

Bytes Content(uint32_t block) { return Bytes(100 + block, static_cast<std::byte>(block)); }

Catalog MakeCatalog(uint32_t voxels) {
  Catalog catalog;
  catalog.voxels.resize(voxels);
  for (uint32_t b = 0; b < 2 * voxels; ++b) {
    const Bytes bytes = Content(b);
    catalog.voxels[b / 2].blocks[b % 2] = {0, static_cast<uint32_t>(bytes.size()), 4096, Checksum(bytes)};
  }
  return catalog;
}

/// Behaves by its mood: answers, at once or after 0.02 s, fails, damages, refuses or stays silent.
class FakeSource final : public VoxelSource {
 public:
  enum class Mood { kAnswers, kIsSlow, kFails, kDamages, kRefuses, kSilent };
  FakeSource(boost::asio::io_context& io, const Catalog& catalog, Mood& mood, std::vector<uint32_t>& asked)
      : io_(io), catalog_(catalog), mood_(mood), asked_(asked) {}
  void Fetch(BlockKey block, Done done) override {
    const uint32_t number = catalog_.NumberOf(block);
    asked_.push_back(number);
    Bytes bytes = Content(number);
    if (mood_ == Mood::kSilent) return;
    if (mood_ == Mood::kDamages) bytes[3] ^= std::byte{1};
    const bool fails = mood_ == Mood::kFails || mood_ == Mood::kRefuses, permanent = mood_ == Mood::kRefuses;
    const int after_ms = mood_ == Mood::kIsSlow ? 20 : 0;
    auto timer = std::make_shared<boost::asio::steady_timer>(io_, std::chrono::milliseconds(after_ms));
    timer->async_wait(
        [timer, done = std::move(done), bytes = std::move(bytes), fails, permanent](auto) mutable {
          fails ? done(tl::unexpected<Error>(
                      Error{"out of order", permanent ? ErrorKind::kPermanent : ErrorKind::kFailed}))
                : done(std::move(bytes));
        });
  }

 private:
  boost::asio::io_context& io_;
  const Catalog& catalog_;
  Mood& mood_;
  std::vector<uint32_t>& asked_;
};

struct SetFixture {
  boost::asio::io_context io;
  Catalog catalog = MakeCatalog(50);
  std::deque<FakeSource::Mood> moods;
  std::deque<std::vector<uint32_t>> asked;
  std::vector<std::string> log;
  std::unique_ptr<SourceSet> set;

  explicit SetFixture(std::vector<FakeSource::Mood> sources, double give_up_after_s = 60) {
    set = std::make_unique<SourceSet>(io, catalog, give_up_after_s,
                                      [this](const std::string& s) { log.push_back(s); });
    for (const auto mood : sources) {
      moods.push_back(mood);
      asked.emplace_back();
      set->Add(SourceKind::kTcp, "s" + std::to_string(moods.size()), Make());
    }
  }
  std::unique_ptr<VoxelSource> Make() {
    return std::make_unique<FakeSource>(io, catalog, moods.back(), asked.back());
  }
  /// Runs until the block has come or its fetch has ended.
  Result<Bytes> Get(uint32_t block) {
    std::optional<Result<Bytes>> got;
    set->Fetch(test::VoxelBlock(block), [&](Result<Bytes> r) { got = std::move(r); });
    io.restart();
    while (!got) io.run_one();
    return std::move(*got);
  }
};
using Mood = FakeSource::Mood;

}  // namespace

TEST_CASE("Homes are spread evenly, and a lost source moves only its own blocks") {
  const std::vector<uint64_t> four{11, 22, 33, 44}, three{11, 22, 44};
  std::map<uint64_t, int> homes;
  for (uint32_t block = 0; block < 4000; ++block) {
    const auto before = HomeOrder(block, four), after = HomeOrder(block, three);
    CHECK(before.size() == 4);
    ++homes[four[before[0]]];
    if (four[before[0]] != 33)
      CHECK(three[after[0]] == four[before[0]]);
    else
      CHECK(three[after[0]] == four[before[1]]);
  }
  for (const auto& [key, count] : homes) CHECK(std::abs(count - 1000) < 150);
}

TEST_CASE("Back-off doubles up to its limit and ends with an answer") {
  BackOff back_off(7);
  CHECK(back_off.Open(0));
  double now_s = 0, waited_s = 0;
  for (int i = 0; i < 12; ++i) {
    back_off.Failed(now_s);
    CHECK_FALSE(back_off.Open(now_s));
    double opens_s = now_s;
    while (!back_off.Open(opens_s)) opens_s += 0.001;
    if (i < 5) CHECK(opens_s - now_s > waited_s * 1.3);
    waited_s = opens_s - now_s;
    CHECK(waited_s <= BackOff::kMostS + 0.01);
    now_s = opens_s;
  }
  CHECK(waited_s > BackOff::kMostS * 0.7);
  back_off.Succeeded();
  CHECK(back_off.Open(0));
}

TEST_CASE("Retries are bounded by the number of requests, and by time") {
  RetryBudget budget;
  int spent = 0;
  while (budget.Spend(0)) ++spent;
  CHECK(spent == static_cast<int>(RetryBudget::kMost));
  for (int i = 0; i < 95; ++i) budget.Requested();
  spent = 0;
  while (budget.Spend(0)) ++spent;
  CHECK(spent == 9);
  spent = 0;
  while (budget.Spend(5)) ++spent;
  CHECK(spent >= 5);
  CHECK(spent <= 6);
}

TEST_CASE("A block is requested from its home unless another source is much faster") {
  const std::vector<uint32_t> order{2, 0, 1};
  std::vector<SourceView> views{{1.0, true}, {0.9, true}, {1.5, true}};
  CHECK(ChooseSource(order, views) == 2);
  views[1].mean_answer_s = 0.6;
  CHECK(ChooseSource(order, views) == 1);
  views[1].open = views[2].open = false;
  CHECK(ChooseSource(order, views) == 0);
  views[0].open = false;
  CHECK(ChooseSource(order, views) == -1);
}

TEST_CASE("Blocks are fetched from their homes, and from the other source when one fails") {
  SetFixture f({Mood::kAnswers, Mood::kAnswers});
  for (uint32_t b = 0; b < 100; ++b) CHECK(*f.Get(b) == Content(b));
  CHECK(f.asked[0].size() + f.asked[1].size() == 100);
  CHECK(f.asked[0].size() > 20);
  CHECK(f.asked[1].size() > 20);
  f.moods[0] = Mood::kFails;
  for (uint32_t b = 0; b < 100; ++b) CHECK(*f.Get(b) == Content(b));
  CHECK(f.set->counters().retries > 0);
  CHECK(f.set->counters().retries < 20);  // a failing source is left alone
}

TEST_CASE("A damaged block is fetched elsewhere; one damaged everywhere is given up with a sentence") {
  SetFixture f({Mood::kDamages, Mood::kAnswers});
  for (uint32_t b = 0; b < 20; ++b) CHECK(*f.Get(b) == Content(b));
  CHECK(f.set->counters().damaged > 0);
  f.moods[1] = Mood::kDamages;
  const auto result = f.Get(30);
  REQUIRE_FALSE(result.has_value());
  CHECK_THAT(result.error().message, Catch::Contains("block 30 arrived damaged"));
}

TEST_CASE("A block that every source refuses is given up at once") {
  SetFixture f({Mood::kRefuses, Mood::kRefuses});
  const auto result = f.Get(3);
  REQUIRE_FALSE(result.has_value());
  CHECK(result.error().message == "out of order");
  CHECK(f.asked[0].size() + f.asked[1].size() == 2);
}

TEST_CASE("Blocks wait while no source answers, and are fetched when one is back") {
  SetFixture f({Mood::kFails});
  std::optional<Result<Bytes>> got;
  f.set->Fetch(5_b, [&](Result<Bytes> r) { got = std::move(r); });
  f.io.run_for(std::chrono::milliseconds(300));
  CHECK_FALSE(got.has_value());
  CHECK(f.asked[0].size() < 10);
  CHECK(f.log.size() == 1);
  f.moods[0] = Mood::kAnswers;
  while (!got) f.io.run_one();
  CHECK(**got == Content(5));
  CHECK_THAT(f.log.back(), Catch::Contains("answers again"));

  SetFixture never({Mood::kFails}, 0.2);
  CHECK_FALSE(never.Get(5).has_value());
}

TEST_CASE("A late block is requested elsewhere as well") {
  SetFixture f({Mood::kSilent, Mood::kSilent, Mood::kAnswers});
  for (uint32_t b = 0; b < 8; ++b) CHECK(*f.Get(b) == Content(b));
  CHECK(f.set->counters().hedges > 0);
}

TEST_CASE("A source that falls silent delays requests only until it is noticed") {
  SetFixture f({Mood::kAnswers, Mood::kAnswers});
  for (uint32_t b = 0; b < 40; ++b) CHECK(*f.Get(b) == Content(b));
  f.moods[0] = Mood::kSilent;
  // Many more at once than the budget has retries for.
  const auto start = std::chrono::steady_clock::now();
  size_t come = 0;
  for (uint32_t round = 0; round < 2; ++round)
    for (uint32_t b = 0; b < 100; ++b)
      f.set->Fetch(test::VoxelBlock(b),
                   [&come, b](Result<Bytes> r) { come += r.has_value() && *r == Content(b); });
  f.io.restart();
  while (come < 200) f.io.run_one();
  CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(3));
  // From now on nobody asks it.
  const size_t asked = f.asked[0].size();
  for (uint32_t b = 0; b < 100; ++b) CHECK(*f.Get(b) == Content(b));
  CHECK(f.asked[0].size() == asked);
}

TEST_CASE(
    "A worker that is said to hold a block gets the request when its home is slow, and its refusal costs no "
    "retry") {
  SetFixture f({Mood::kAnswers});
  Mood peer_mood = Mood::kAnswers;
  std::vector<uint32_t> peer_asked;
  const auto make = [&](const Endpoint&) {
    return std::make_unique<FakeSource>(f.io, f.catalog, peer_mood, peer_asked);
  };
  f.set->SetPeers({{7}, {"127.0.0.1:1"}}, make);
  for (const BlockKey block : {4_b, 5_b, 6_b}) f.set->SetHolder(block, 7);
  f.set->SetHolder(9_b, 8);  // nobody knows that one
  CHECK(*f.Get(4) == Content(4));
  CHECK(*f.Get(9) == Content(9));
  CHECK(peer_asked.empty());
  // The home of many: whoever has the block is asked as soon as that is known.
  f.moods[0] = Mood::kIsSlow;
  for (uint32_t block = 10; block < 30; ++block) CHECK(*f.Get(block) == Content(block));
  CHECK(*f.Get(5) == Content(5));
  CHECK(peer_asked == std::vector<uint32_t>{5});
  CHECK(f.set->counters().bytes_from[static_cast<size_t>(SourceKind::kPeer)] == Content(5).size());
  peer_mood = Mood::kRefuses;
  CHECK(*f.Get(6) == Content(6));
  CHECK(peer_asked == std::vector<uint32_t>{5, 6});
  CHECK(f.set->counters().retries == 0);
  f.set->SetPeers({{}, {}}, make);
  f.set->SetHolder(8_b, 7);
  CHECK(*f.Get(8) == Content(8));
  CHECK(peer_asked.size() == 2);
}

TEST_CASE("Sources are named in four ways") {
  CHECK(ParseSource("master")->master);
  CHECK(ParseSource("10.0.0.1:99")->server.port == 99);
  CHECK(ParseSource("file:/a b/c.quarry")->place == "/a b/c.quarry");
  CHECK(ParseSource("https://h/x.quarry")->kind == SourceKind::kHttp);
  for (const char* bad : {"", "file:", "host", "host:99999", "ftp://x/y"})
    CHECK(ParseSource(bad).error().exit_status() == 2);
}

TEST_CASE("Stored blocks are evicted least recently used first, unused prefetched ones before all") {
  boost::asio::io_context io;
  Mood mood = Mood::kAnswers;
  std::vector<uint32_t> asked;
  const Catalog catalog = MakeCatalog(20);
  FakeSource inner(io, catalog, mood, asked);
  CacheInventory inventory;
  StoredCache cache(inner, 1000, inventory);
  const auto get = [&](uint32_t block) {
    Bytes got;
    cache.Fetch(test::VoxelBlock(block), [&](Result<Bytes> r) { got = *r; });
    io.restart();
    io.run();
    CHECK(got == Content(block));
  };
  const auto prefetch = [&](uint32_t block) {
    const bool asked_for = cache.Prefetch(test::VoxelBlock(block), [] {});
    io.restart();
    io.run();
    return asked_for;
  };
  for (uint32_t b = 0; b < 6; ++b) get(b);  // 615 bytes
  CHECK(prefetch(20));
  CHECK(prefetch(21));
  CHECK(prefetch(22));  // 978 bytes
  CHECK_FALSE(prefetch(22));
  CHECK_FALSE(prefetch(23));  // they have their quarter
  get(6);                     // 20 goes, which nobody has asked for
  CHECK(cache.counters().prefetch_wasted_bytes == Content(20).size());
  CHECK_FALSE(inventory.Has(20_b));
  get(21);
  CHECK(cache.counters().hit_bytes == Content(21).size());
  get(0);
  get(7);  // 22 goes
  CHECK(cache.Find(22_b) == nullptr);
  get(8);  // and 1, of which the use is the longest ago
  CHECK(cache.Find(1_b) == nullptr);
  CHECK(cache.Find(0_b) != nullptr);
  const size_t before = asked.size();
  get(0);
  CHECK(asked.size() == before);
  // A request for a block that is being prefetched shares the answer.
  CHECK(cache.Prefetch(30_b, [] {}));
  get(30);
  CHECK(asked.size() == before + 1);
}

TEST_CASE("A worker reports its blocks as changes, once for both tiers") {
  CacheInventory h;
  h.Set(1_b, CacheInventory::kStored, true);
  h.Set(1_b, CacheInventory::kDecoded, true);
  h.Set(2_b, CacheInventory::kDecoded, true);
  h.Set(2_b, CacheInventory::kDecoded, false);
  auto changes = h.TakeChanges();
  CHECK(changes.come == std::vector<BlockKey>{1_b});
  CHECK(changes.gone == std::vector<BlockKey>{2_b});  // harmless: the master did not have it
  h.Set(1_b, CacheInventory::kStored, false);
  CHECK(h.TakeChanges().gone.empty());
  h.Set(1_b, CacheInventory::kDecoded, false);
  CHECK(h.TakeChanges().gone == std::vector<BlockKey>{1_b});
  CHECK(h.TakeAll().empty());
}

}  // namespace quarry
