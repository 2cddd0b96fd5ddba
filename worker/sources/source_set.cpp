#include "worker/sources/source_set.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <map>
#include <unordered_map>
#include <utility>

#include "common/base/bytes.h"
#include "worker/sources/source_policy.h"

namespace quarry {
namespace {

// Period of checks for late answers; it bounds how late a hedge or retry is.
constexpr auto kTick = std::chrono::milliseconds(50);
constexpr double kOversleptS = 2;  // a tick later than this means that the process was stopped
/// Seconds without an answer after which a source that owes one is passed over: for a source that has
/// answered before, and for a new source, whose first answer also opens the connection. Trades idle threads
/// behind a silent link against leaving a slow source. `tests/chaos/run --seeds 41` takes 12 s with these
/// limits, 20 s without.
constexpr double kMuteS = 1, kMuteAtFirstS = 3;
constexpr size_t kMostHints = 1u << 16;  // a forgotten hint costs a request to a server

bool Contains(const std::vector<uint32_t>& list, uint32_t value) {
  return std::find(list.begin(), list.end(), value) != list.end();
}

uint64_t KeyOf(const std::string& name) { return Checksum(AsBytes(name)); }

}  // namespace

/// All state. Times are in seconds of the steady clock.
struct SourceSet::Impl : std::enable_shared_from_this<SourceSet::Impl> {
  struct Origin {
    SourceKind kind;
    std::string name;
    std::unique_ptr<VoxelSource> source;
    BackOff back_off;
    AnswerTime answers;
    bool has_refused = false;  ///< a refusal was logged
    uint32_t owed = 0;         ///< answers outstanding
    double heard_s = 0;        ///< time of the last answer, or of the first request after none was owed

    /// Whether the source owes answers and has given none for long. Its machine or the way to it has probably
    /// failed without an error so far.
    bool Mute(double now_s) const {
      const double most_s =
          answers.mean_s() > 0 ? std::max(kMuteS, 2 * answers.HedgeAfterS()) : kMuteAtFirstS;
      return owed > 0 && now_s - heard_s > most_s;
    }
  };
  /// A requested block that has not arrived.
  struct Fetching {
    BlockKey block;
    Done done;
    double since_s, asked_s = 0;
    std::vector<uint32_t> asked;  ///< ids of the origins that owe an answer
    int failures = 0, damaged = 0;
    std::vector<uint32_t> refused_by;  ///< origins that refused this block
    std::string last_error;
  };

  Impl(boost::asio::io_context& context, const Catalog& c, double limit_s,
       std::function<void(const std::string&)> log_line)
      : io(context), catalog(c), give_up_after_s(limit_s), log(std::move(log_line)), timer(context) {}

  static double Now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }

  /// The origins in the order in which this block asks them: its homes, then a worker that is said to hold
  /// it. A worker serves more slowly while it renders, so homes come first until their load makes them
  /// slower.
  std::vector<uint32_t> OrderFor(BlockKey block) const {
    std::vector<uint32_t> order;
    for (const uint32_t home : HomeOrder(catalog.NumberOf(block), keys)) order.push_back(homes[home]);
    if (const auto hint = holders.find(block); hint != holders.end())
      if (const auto peer = peers.find(hint->second); peer != peers.end()) order.push_back(peer->second);
    return order;
  }

  /// The expected answer time. A worker that was never asked gets the mean of all workers: a first request
  /// costs both sides a TLS handshake.
  double ExpectedAnswer(const Origin& origin) const {
    if (origin.kind == SourceKind::kPeer && origin.answers.mean_s() == 0) return peer_answers.mean_s();
    return origin.answers.mean_s();
  }

  /// Asks one more source. Returns: false when none may be asked now.
  bool Ask(uint64_t id, Fetching& f) {
    const double now_s = Now();
    const std::vector<uint32_t> order = OrderFor(f.block);
    std::vector<SourceView> views(next_origin, {0, false});
    int chosen = -1;
    for (const bool mute_too : {false, true}) {  // mute sources only when no other is open
      for (const uint32_t o : order) {
        const Origin& origin = *origins.at(o);
        views[o] = {ExpectedAnswer(origin), origin.back_off.Open(now_s) &&
                                                (mute_too || !origin.Mute(now_s)) &&
                                                !Contains(f.refused_by, o) && !Contains(f.asked, o)};
      }
      if (chosen < 0) chosen = ChooseSource(order, views);
    }
    if (chosen < 0) return false;
    const auto origin = static_cast<uint32_t>(chosen);
    f.asked.push_back(origin);
    if (origins.at(origin)->owed++ == 0) origins.at(origin)->heard_s = now_s;
    f.asked_s = now_s;
    // `f` must not be used after this: the answer may come at once.
    origins.at(origin)->source->Fetch(f.block, [self = weak_from_this(), id, origin, now_s](Result<Bytes> r) {
      if (const auto impl = self.lock()) impl->Answered(id, origin, now_s, std::move(r));
    });
    return true;
  }

  void Answered(uint64_t id, uint32_t from, double asked_s, Result<Bytes> result) {
    const auto o = origins.find(from);
    const auto it = fetching.find(id);
    const bool wanted = it != fetching.end();
    if (o != origins.end()) {
      --o->second->owed;
      o->second->heard_s = Now();
    }
    const BlockKey block = wanted ? it->second.block : BlockKey{};
    bool good = result.has_value();
    if (good && wanted) {
      const BlockEntry& entry = catalog.block(block);
      good = result->size() == entry.stored && Checksum(*result) == entry.checksum;
      if (!good) {
        ++counters.damaged;
        ++it->second.damaged;
        result = Fail(fmt::format("block {} arrived damaged {} times (checksum)", catalog.NumberOf(block),
                                  it->second.damaged));
      }
    }
    // The server works, but has no such block to give.
    const bool refused = !result && result.error().permanent();
    if (o != origins.end() && !refused) Judge(*o->second, good, asked_s, good ? "" : result.error().message);
    if (!wanted) return;
    Fetching& f = it->second;
    std::erase(f.asked, from);
    if (good) {
      const double now_s = Now();
      counters.busy_us += static_cast<uint64_t>((now_s - std::max(f.since_s, busy_until_s)) * 1e6);
      busy_until_s = now_s;
      if (o != origins.end()) counters.bytes_from[static_cast<size_t>(o->second->kind)] += result->size();
      holders.erase(block);
      Done done = std::move(f.done);
      fetching.erase(it);
      return done(std::move(result));
    }
    if (o == origins.end() || o->second->kind == SourceKind::kPeer) {
      // Hints are often outdated: a server is asked at once, and this does not count as a retry.
      holders.erase(block);
      if (f.asked.empty()) Ask(id, f);
      return;
    }
    ++f.failures;
    if (refused) {
      if (!std::exchange(o->second->has_refused, true))
        log(fmt::format("{} refuses: {}", o->second->name, result.error().message));
      f.refused_by.push_back(from);
    }
    f.last_error = result.error().message;
    if (f.damaged >= kMostDamaged || f.refused_by.size() == homes.size()) return GiveUp(id);
    if (f.asked.empty()) Again(id, f);
  }

  /// Updates a source's statistics with the outcome of an answer.
  void Judge(Origin& origin, bool good, double asked_s, const std::string& why) {
    const double now_s = Now();
    if (good) {
      origin.answers.Add(now_s - asked_s);
      if (origin.kind == SourceKind::kPeer) peer_answers.Add(now_s - asked_s);
      if (origin.back_off.failures() > 1) log(fmt::format("{} answers again", origin.name));
      return origin.back_off.Succeeded();
    }
    if (origin.back_off.Open(now_s)) origin.back_off.Failed(now_s);
    if (origin.back_off.failures() == 2) log(fmt::format("{} fails: {}", origin.name, why));
  }

  /// Retries if the budget allows; otherwise a later tick does.
  void Again(uint64_t id, Fetching& f) {
    if (!budget.Spend(Now())) return;
    ++counters.retries;
    Ask(id, f);
  }

  void GiveUp(uint64_t id) {
    const auto it = fetching.find(id);
    Error error{it->second.last_error.empty() ? "no source of voxels answers" : it->second.last_error};
    Done done = std::move(it->second.done);
    fetching.erase(it);
    done(tl::unexpected<Error>(std::move(error)));
  }

  void Tick() {
    const double now_s = Now();
    // Time during which this process was stopped does not count against the sources.
    const double overslept_s = now_s - tick_due_s;
    std::vector<uint64_t> ids;
    for (auto& [id, f] : fetching) {
      if (overslept_s > kOversleptS) f.since_s = std::min(now_s, f.since_s + overslept_s);
      ids.push_back(id);
    }
    for (const uint64_t id : ids) {
      const auto it = fetching.find(id);
      if (it == fetching.end()) continue;
      Fetching& f = it->second;
      if (now_s - f.since_s > give_up_after_s) {
        GiveUp(id);
      } else if (f.asked.empty()) {
        if (f.failures == 0)
          Ask(id, f);
        else
          Again(id, f);
      } else if (f.asked.size() < origins.size()) {
        const auto o = origins.find(f.asked.back());
        // A mute source is treated as failed: the next source is asked at once, outside the budget.
        if (o != origins.end() && o->second->Mute(now_s)) {
          counters.retries += Ask(id, f);
          continue;
        }
        if (o != origins.end() && now_s - f.asked_s < o->second->answers.HedgeAfterS()) continue;
        if (budget.Spend(now_s) && Ask(id, f)) ++counters.hedges;
      }
    }
    Arm();
  }

  void Arm() {
    armed = !fetching.empty();
    if (!armed) return;
    timer.expires_after(kTick);
    tick_due_s = Now() + std::chrono::duration<double>(kTick).count();
    timer.async_wait([self = weak_from_this()](const boost::system::error_code& e) {
      if (const auto impl = self.lock(); impl && !e) impl->Tick();
    });
  }

  boost::asio::io_context& io;
  const Catalog& catalog;
  double give_up_after_s;
  std::function<void(const std::string&)> log;
  boost::asio::steady_timer timer;
  bool armed = false;
  double tick_due_s = 0;
  std::unordered_map<uint32_t, std::unique_ptr<Origin>> origins;  ///< by id
  uint32_t next_origin = 0;
  std::vector<uint32_t> homes;                     ///< ids of the sources that are not workers
  std::vector<uint64_t> keys;                      ///< keys of `homes`
  std::map<uint32_t, uint32_t> peers;              ///< worker to origin id
  std::map<uint32_t, std::string> peer_endpoints;  ///< worker to HOST:PORT
  std::unordered_map<BlockKey, uint32_t> holders;  ///< block to a worker that has it
  AnswerTime peer_answers;                         ///< over all workers
  std::map<uint64_t, Fetching> fetching;           ///< oldest first
  uint64_t next_fetch = 1;
  RetryBudget budget;
  Counters counters;
  double busy_until_s = 0;  ///< the time up to which counters.busy_us counts
};

SourceSet::SourceSet(boost::asio::io_context& io, const Catalog& catalog, double give_up_after_s,
                     std::function<void(const std::string&)> log)
    : impl_(std::make_shared<Impl>(io, catalog, give_up_after_s, std::move(log))) {}

SourceSet::~SourceSet() {
  impl_->timer.cancel();
  impl_->fetching.clear();
}

void SourceSet::Add(SourceKind kind, std::string name, std::unique_ptr<VoxelSource> source) {
  const uint32_t id = impl_->next_origin++;
  const uint64_t key = KeyOf(name);
  impl_->origins[id].reset(new Impl::Origin{kind, std::move(name), std::move(source), BackOff(key), {}});
  impl_->homes.push_back(id);
  impl_->keys.push_back(key);
}

void SourceSet::SetPeers(const Peers& peers,
                         std::function<std::unique_ptr<VoxelSource>(const Endpoint&)> make) {
  std::map<uint32_t, std::string> now;
  for (size_t i = 0; i < peers.workers.size(); ++i) now[peers.workers[i]] = peers.endpoints[i];
  std::erase_if(impl_->peers, [&](const auto& peer) {
    const auto it = now.find(peer.first);
    if (it != now.end() && it->second == impl_->peer_endpoints[peer.first]) return false;
    // Its outstanding answers are requested again from other sources.
    const uint32_t gone = peer.second;
    impl_->origins.erase(gone);
    for (auto& [id, f] : impl_->fetching) std::erase(f.asked, gone);
    return true;
  });
  for (const auto& [worker, text] : now) {
    if (impl_->peers.contains(worker)) continue;
    const auto endpoint = ParseEndpoint(text, "a worker's address");
    if (!endpoint) continue;
    const uint32_t id = impl_->next_origin++;
    impl_->origins[id].reset(
        new Impl::Origin{SourceKind::kPeer, "worker at " + text, make(*endpoint), BackOff(KeyOf(text)), {}});
    impl_->peers[worker] = id;
  }
  impl_->peer_endpoints = std::move(now);
}

void SourceSet::SetHolder(BlockKey block, uint32_t worker) {
  if (impl_->holders.size() >= kMostHints) impl_->holders.clear();
  impl_->holders[block] = worker;
}

void SourceSet::Fetch(BlockKey block, Done done) {
  const uint64_t id = impl_->next_fetch++;
  auto& f = impl_->fetching[id];
  f.block = block;
  f.done = std::move(done);
  f.since_s = Impl::Now();
  impl_->budget.Requested();
  impl_->Ask(id, f);
  if (!impl_->armed) impl_->Arm();
}

const SourceSet::Counters& SourceSet::counters() const { return impl_->counters; }

}  // namespace quarry
