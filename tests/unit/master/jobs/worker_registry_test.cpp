#include "master/worker_registry.h"

#include <catch2/catch.hpp>

#include "tests/support/cluster/still_connection.h"

namespace quarry {
namespace {

using Somebody = test::StillConnection;

/// Counters of a worker that has received, fetched, loaded and decoded so much.
WorkerStatus Counted(uint64_t received, uint64_t fetch_us, uint64_t loaded, uint64_t decode_us) {
  WorkerStatus alive;
  alive.voxel_bytes_received = received;
  alive.fetch_us = fetch_us;
  alive.voxel_bytes_loaded = loaded;
  alive.decode_us = decode_us;
  return alive;
}

WorkerRecord& Joined(WorkerRegistry& registry, uint64_t instance) {
  return registry.Add(std::make_shared<Somebody>(), Hello{Role::kWorker, "w", 1, instance, 0});
}

}  // namespace

TEST_CASE("An unknown rate of fetching is taken as 100 Mbit/s, unknown decoding as free", "[registry]") {
  WorkerRegistry registry;
  CHECK(registry.SecondsPerByte(7) == Approx(8e-8));
  WorkerRegistry::Update(Joined(registry, 1), Counted(1000, 900'000, 7000, 900'000));
  CHECK(registry.SecondsPerByte(7) == Approx(8e-8));
}

TEST_CASE("A stored byte costs the time to fetch and decode it once", "[registry]") {
  WorkerRegistry registry;
  WorkerRecord& worker = Joined(registry, 1);
  // 2 MB in 1 s; decoded seven times over, 140 MB, in 0.7 s.
  WorkerRegistry::Update(worker, Counted(2'000'000, 1'000'000, 140'000'000, 700'000));
  CHECK(registry.SecondsPerByte(10) == Approx(5e-7 + 5e-8));
  CHECK(registry.SecondsPerByte(5) == Approx(5e-7 + 2.5e-8));
  // Another one, whose disk cache is warm, has received nothing.
  WorkerRegistry::Update(Joined(registry, 2), Counted(0, 0, 60'000'000, 1'300'000));
  CHECK(registry.SecondsPerByte(10) == Approx(5e-7 + 1e-7));
  WorkerRegistry::Update(worker, Counted(0, 0, 140'000'000, 700'000));
  CHECK(registry.SecondsPerByte(10) == Approx(8e-8 + 1e-7));
}

}  // namespace quarry
