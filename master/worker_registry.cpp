#include "master/worker_registry.h"

#include <fmt/format.h>

#include <algorithm>

namespace quarry {
namespace {

/// Instances whose id is remembered: bounds memory against a peer that connects again and again.
constexpr size_t kMostKnown = 1u << 16;
/// Threads believed, the most that quarry-worker takes.
constexpr uint32_t kMostThreads = 1024;

}  // namespace

void WorkerRecord::SetServesAt(uint16_t port) {
  const std::string& peer = connection->peer();
  serves_at = port == 0 ? std::string() : fmt::format("{}:{}", peer.substr(0, peer.rfind(':')), port);
}

void WorkerRecord::TellSelection(const ViewParts& parts) {
  if (!parts.selection || std::ranges::find(selections_told, parts.id()) != selections_told.end()) return;
  selections_told.push_back(parts.id());
  if (selections_told.size() > kMostSelections) selections_told.pop_front();
  connection->Send(MakeMessage(MessageType::kSelection, *parts.selection));
}

void WorkerRecord::TellNeedsOf(const View& view) {
  TellSelection(view.parts);
  const SceneId& wanted = view.environment.id;
  if (!view.environment.shines() || !environments || environments_told.contains(wanted)) return;
  const Environments::Served* const served = environments->Find(wanted);
  if (!served) return;
  environments_told.insert(wanted);
  Message m = MakeMessage(MessageType::kEnvironment, EnvironmentSetup{wanted});
  m.raw = served->packed_catalog;
  connection->Send(std::move(m));
}

WorkerRecord& WorkerRegistry::Add(const std::shared_ptr<Connection>& connection, const Hello& hello) {
  if (known_.size() > kMostKnown) known_.clear();
  const auto [known, fresh] = known_.try_emplace(hello.instance, next_id_);
  if (fresh) ++next_id_;
  WorkerRecord& worker = workers_[known->second];
  worker.connection = connection;
  worker.environments = environments_;
  worker.id = known->second;
  worker.instance = hello.instance;
  worker.name = hello.name;
  worker.threads = std::clamp(hello.threads, 1u, kMostThreads);
  worker.SetServesAt(hello.serves_at);
  ids_[connection.get()] = worker.id;
  return worker;
}

void WorkerRegistry::Remove(const Connection* connection) {
  const auto it = ids_.find(connection);
  if (it == ids_.end()) return;
  workers_.erase(it->second);
  ids_.erase(it);
}

WorkerRecord* WorkerRegistry::Find(const Connection* connection) {
  const auto it = ids_.find(connection);
  return it == ids_.end() ? nullptr : &workers_.at(it->second);
}

WorkerRecord* WorkerRegistry::FindById(uint32_t id) {
  const auto it = workers_.find(id);
  return it == workers_.end() ? nullptr : &it->second;
}

WorkerRecord* WorkerRegistry::FindInstance(uint64_t instance) {
  const auto it = known_.find(instance);
  return it == known_.end() ? nullptr : FindById(it->second);
}

void WorkerRegistry::Update(WorkerRecord& worker, const WorkerStatus& status) {
  worker.counters = status;
  worker.tiles_wanted = status.tiles_wanted;
  if (status.whole) worker.holds.Clear();
  for (const uint32_t block : status.cached) worker.holds.Set(block, true);
  for (const uint32_t block : status.dropped) worker.holds.Set(block, false);
  worker.counters.cached.clear();
  worker.counters.dropped.clear();
}

std::map<uint32_t, uint32_t> WorkerRegistry::Proven() const {
  std::map<uint32_t, uint32_t> ready, proven;
  for (const auto& [id, worker] : workers_) {
    if (!worker.ready) continue;
    ready.emplace(id, worker.threads);
    if (worker.proven()) proven.emplace(id, worker.threads);
  }
  return proven.empty() ? ready : proven;
}

Peers WorkerRegistry::MakePeers() const {
  Peers peers;
  for (const auto& [id, worker] : workers_) {
    if (worker.serves_at.empty()) continue;
    peers.workers.push_back(id);
    peers.endpoints.push_back(worker.serves_at);
  }
  return peers;
}

double WorkerRegistry::SecondsPerByte(double decoded) const {
  /// Seconds a byte, and bytes before the measured time is trusted.
  constexpr double kUsualFetch = 8e-8, kKnownBytes = 1 << 20;
  /// Seconds a byte, 100 GB/s and 10 KB/s: counters beyond these bounds are forged or broken.
  constexpr double kLeast = 1e-11, kMost = 1e-4;
  const auto add = [&](uint64_t bytes, uint64_t us, double& sum_bytes, double& sum_s) {
    const auto b = static_cast<double>(bytes), s = static_cast<double>(us) * 1e-6;
    if (s < kLeast * b || s > kMost * std::max(b, kKnownBytes)) return;
    sum_bytes += b;
    sum_s += s;
  };
  double received = 0, fetch_s = 0, loaded = 0, decode_s = 0;
  for (const auto& [id, worker] : workers_) {
    const WorkerStatus& c = worker.counters;
    add(c.voxel_bytes_received, c.fetch_us, received, fetch_s);
    add(c.voxel_bytes_loaded, c.decode_us, loaded, decode_s);
  }
  return (received < kKnownBytes ? kUsualFetch : fetch_s / received) +
         (loaded < kKnownBytes ? 0 : decode_s / loaded) * decoded;
}

double WorkerRegistry::DecodeSeconds() const {
  double s = 0;
  for (const auto& [id, worker] : workers_) s += static_cast<double>(worker.counters.decode_us) * 1e-6;
  return s;
}

uint32_t WorkerRegistry::HolderOf(uint32_t block, uint32_t but) const {
  const auto start = workers_.lower_bound(block % (next_id_ + 1));
  const auto fits = [&](const auto& entry) {
    return entry.first != but && !entry.second.serves_at.empty() && entry.second.holds.Has(block);
  };
  auto found = std::find_if(start, workers_.end(), fits);
  if (found == workers_.end()) {
    found = std::find_if(workers_.begin(), start, fits);
    if (found == start) return 0;
  }
  return found->first;
}

}  // namespace quarry
