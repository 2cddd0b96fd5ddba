#include "tests/bench/rays/embree_rays.h"

#include <bit>
#include <chrono>
#include <cstring>

#include "common/base/resource.h"
#include "tests/bench/rays/embree_scene.h"

namespace quarry::bench {
namespace {

#ifdef __AVX512F__
#error "the benches are built for the baseline"
#endif

constexpr uint32_t kPacketRays = 16;

/// Which rays of a packet there are: -1 or 0, aligned as Embree wants.
struct alignas(64) Valid {
  int lanes[kPacketRays] = {};
};

}  // namespace

struct EmbreeRays::Impl {
  explicit Impl(EmbreeScene made) : owner(std::move(made)), scene(owner.scene()) {}

  EmbreeScene owner;
  RTCScene scene;
  std::vector<RTCRayHit> fresh, rays;
  std::vector<RTCRayHit16> fresh_packets, packets;
  std::vector<Valid> valid;
  bool any = false, coherent = false;
  EmbreeMode last = EmbreeMode::kSingle;

  void Single() {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    for (RTCRayHit& r : rays)
      any ? rtcOccluded1(scene, &context, &r.ray) : rtcIntersect1(scene, &context, &r);
  }
  void Packets() {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    for (size_t p = 0; p < packets.size(); ++p)
      any ? rtcOccluded16(valid[p].lanes, scene, &context, &reinterpret_cast<RTCRay16&>(packets[p].ray))
          : rtcIntersect16(valid[p].lanes, scene, &context, &packets[p]);
  }
  void Stream() {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    constexpr size_t kBatch = 4096;
    for (size_t at = 0; at < rays.size(); at += kBatch) {
      const auto count = static_cast<unsigned>(std::min(kBatch, rays.size() - at));
      any ? rtcOccluded1M(scene, &context, &rays[at].ray, count, sizeof(RTCRayHit))
          : rtcIntersect1M(scene, &context, &rays[at], count, sizeof(RTCRayHit));
    }
  }
};

EmbreeRays::EmbreeRays(const test::ResidentScene& scene, bool robust)
    : impl_(
          std::make_unique<Impl>(EmbreeScene(scene.voxels(), scene.catalog().meta.input_triangles, robust))) {
}

EmbreeRays::~EmbreeRays() = default;

void EmbreeRays::SetRays(const std::vector<RayPacket>& packets, const std::vector<uint64_t>& active, bool any,
                         bool coherent) {
  Impl& m = *impl_;
  m.any = any;
  m.coherent = coherent;
  m.fresh.clear();
  // Packets of 16 are quarters of ours, two 8x2 strips: rays near each other.
  m.fresh_packets.assign(packets.size() * 4, {});
  m.valid.assign(packets.size() * 4, {});
  for (size_t p = 0; p < packets.size(); ++p) {
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      const RayPacket& from = packets[p];
      const size_t q = p * 4 + i / kPacketRays, lane = i % kPacketRays;
      if ((active[p] >> i & 1) == 0) continue;
      m.valid[q].lanes[lane] = -1;
      RTCRayHit r{};
      r.ray.org_x = from.origin[0][i];
      r.ray.org_y = from.origin[1][i];
      r.ray.org_z = from.origin[2][i];
      r.ray.dir_x = from.direction[0][i];
      r.ray.dir_y = from.direction[1][i];
      r.ray.dir_z = from.direction[2][i];
      r.ray.tfar = from.hit_t[i];
      r.ray.mask = 0xFFFFFFFFu;
      r.hit.geomID = r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      r.hit.primID = RTC_INVALID_GEOMETRY_ID;
      m.fresh.push_back(r);
      RTCRayHit16& w = m.fresh_packets[q];
      w.ray.org_x[lane] = r.ray.org_x;
      w.ray.org_y[lane] = r.ray.org_y;
      w.ray.org_z[lane] = r.ray.org_z;
      w.ray.dir_x[lane] = r.ray.dir_x;
      w.ray.dir_y[lane] = r.ray.dir_y;
      w.ray.dir_z[lane] = r.ray.dir_z;
      w.ray.tfar[lane] = r.ray.tfar;
      w.ray.mask[lane] = r.ray.mask;
      w.hit.geomID[lane] = w.hit.instID[0][lane] = w.hit.primID[lane] = RTC_INVALID_GEOMETRY_ID;
    }
  }
}

double EmbreeRays::Trace(EmbreeMode mode) {
  impl_->last = mode;
  if (mode == EmbreeMode::kPacket)
    impl_->packets = impl_->fresh_packets;
  else
    impl_->rays = impl_->fresh;
  const auto start = std::chrono::steady_clock::now();
  if (mode == EmbreeMode::kSingle) impl_->Single();
  if (mode == EmbreeMode::kPacket) impl_->Packets();
  if (mode == EmbreeMode::kStream) impl_->Stream();
  return SecondsSince(start);
}

Hit EmbreeRays::Result(size_t index) const {
  const RTCRayHit& r = impl_->rays[index];
  Hit hit;
  if (impl_->any) {
    if (r.ray.tfar < 0) hit.triangle = 0;
    return hit;
  }
  if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) return hit;
  hit.triangle = impl_->owner.place(r.hit.primID).triangle;
  hit.t = r.ray.tfar;
  hit.b1 = r.hit.u;
  hit.b2 = r.hit.v;
  return hit;
}

}  // namespace quarry::bench
