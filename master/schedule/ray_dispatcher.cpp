#include "master/schedule/ray_dispatcher.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace quarry {
namespace {

/// Seconds after which a ray is given to one more worker, doubled with each holder. A judgement: a worker
/// that lives has fetched a ray's blocks by then.
constexpr double kLateRayS = 3;

}  // namespace

void RayDispatcher::RemoveWorker(uint32_t id) {
  workers_.erase(id);
  leases_.Forget(id);
}

uint32_t RayDispatcher::Ask(const RayQuery& ray, const View& view, OnHit on_hit) {
  RayOrder order{.ray = next_ray_, .query = ray, .parts = view.parts, .section = view.section};
  rays_.emplace(next_ray_, Asked{std::move(order), std::move(on_hit)});
  return next_ray_++;
}

void RayDispatcher::Forget(uint32_t ray) {
  rays_.erase(ray);
  leases_.EndAll(ray);
}

/// Gives a ray to the worker with the fewest rays among the workers that do not have it.
void RayDispatcher::Give(uint32_t ray, double now_s) {
  std::map<uint32_t, size_t> held;
  leases_.ForEach([&](uint32_t, const TileLease& lease) { ++held[lease.worker]; });
  std::optional<uint32_t> to;
  for (const uint32_t worker : workers_)
    if (!leases_.Holds(worker, ray) && (!to || held[worker] < held[*to])) to = worker;
  if (!to) return;
  RayOrder& order = rays_.at(ray).order;
  order.lease = leases_.Give(ray, *to, now_s);
  send_(*to, order);
}

void RayDispatcher::Assign(double now_s) {
  for (const auto& [ray, asked] : rays_)
    if (leases_.Of(ray).empty()) Give(ray, now_s);
  for (const uint32_t ray : leases_.Late(
           now_s, [](uint32_t) { return kLateRayS; }, [](uint32_t) { return true; }))
    if (leases_.Of(ray).size() < kMostLiveHolders) Give(ray, now_s);
}

void RayDispatcher::Finish(uint32_t worker, const RayDone& done) {
  const TileLease* lease = leases_.Find(done.ray, done.lease);
  if (!lease || lease->worker != worker) return;
  leases_.EndAll(done.ray);
  const OnHit on_hit = std::move(rays_.extract(done.ray).mapped().on_hit);
  on_hit(done);
}

}  // namespace quarry
