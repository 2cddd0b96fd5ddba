#include "tests/bench/gpu/gpu_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <mutex>
#include <random>

#include "common/base/resource.h"

namespace quarry::bench {
namespace {

/// Share of a batch's packets whose rays find each voxel absent at first: they come again dozens of times.
constexpr uint32_t kSuspendedShare = 32;
/// Every so many batches some voxels are absent.
constexpr uint32_t kBatchesASuspension = 4;
constexpr size_t kMostListed = 8;  // differences

using Packets = std::vector<RayPacket>;

bool SameFloat(float a, float b) { return std::bit_cast<uint32_t>(a) == std::bit_cast<uint32_t>(b); }

/// Whether two rays have ended alike. `steps`: the rays have taken the same steps, so that they wait alike
/// too, and any-hit rays have ended at the same triangle.
bool SameEnd(const RayPacket& a, const RayPacket& b, uint32_t i, bool any, bool steps) {
  const bool seen_a = (a.see_through >> i & 1) != 0, seen_b = (b.see_through >> i & 1) != 0;
  if (steps && (a.waits_for[i] != b.waits_for[i] || !SameFloat(a.t[i], b.t[i]) || a.chain[i] != b.chain[i] ||
                seen_a != seen_b))
    return false;
  if (any && !steps)
    return (a.triangle[i] != kNoTriangle) == (b.triangle[i] != kNoTriangle) &&
           (a.triangle[i] != kNoTriangle || seen_a == seen_b);
  if (a.triangle[i] != b.triangle[i]) return false;
  if (a.triangle[i] == kNoTriangle) return true;
  return SameFloat(a.hit_t[i], b.hit_t[i]) &&
         (any || (SameFloat(a.b1[i], b.b1[i]) && SameFloat(a.b2[i], b.b2[i])));
}

/// One batch of rays after another, through all kernels.
class DeviceCheck {
 public:
  DeviceCheck(GpuScene& scene, uint32_t packets)
      : scene_(scene), packets_(packets), few_(std::max(packets / kSuspendedShare, 1u)) {}

  Result<GpuCheck> Run(uint64_t rays, double seconds) {
    QUARRY_ASSIGN(rays_, cuda::DeviceRays::Make(packets_));
    const auto start = std::chrono::steady_clock::now();
    const std::vector<uint64_t> all(packets_, ~uint64_t{0});
    for (uint32_t batch = 0; out_.rays < rays && (out_.rays == 0 || SecondsSince(start) < seconds); ++batch) {
      MakeRays();
      for (const bool any : {false, true}) QUARRY_TRY(CheckBatch(any, all));
      QUARRY_TRY(CheckGoingOn());
      for (const bool any : {false, true})
        for (const GpuWay& way : kGpuWays) {
          if (batch % kBatchesASuspension != 0) continue;
          QUARRY_TRY(CheckHalves(way, any));
          QUARRY_TRY(CheckSuspended(way, any));
        }
      out_.rays += uint64_t{packets_} * RayPacket::kRays;
    }
    return out_;
  }

 private:
  /// Half of the packets fan out from one point, half are of unrelated rays.
  void MakeRays() {
    const SceneMeta& meta = scene_.resident().catalog().meta;
    const auto point = [&] {
      glm::vec3 p;
      for (int a = 0; a < 3; ++a)
        p[a] = meta.root_lower[a] +
               (meta.root_upper[a] - meta.root_lower[a]) * static_cast<float>(random_() >> 8) * 0x1p-24f;
      return p;
    };
    fresh_.resize(packets_);
    for (RayPacket& packet : fresh_) {
      const bool fan = random_() % 2 != 0;
      const glm::vec3 eye = point(), at = point();
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        Ray ray;
        ray.origin = fan ? eye : point();
        const glm::vec3 to = (fan ? at + (point() - at) * 0.01f : point()) - ray.origin;
        ray.direction = to / std::max(std::sqrt(to.x * to.x + to.y * to.y + to.z * to.z), 1e-20f);
        packet.Set(i, ray);
      }
    }
  }

  void Compare(const Packets& expected, const Packets& found, std::span<const uint64_t> active, bool any,
               bool steps, const std::string& by) {
    std::atomic<uint64_t> differences = 0, traced = 0;
    std::mutex mutex;
    InParallel(found.size(), [&](size_t first, size_t count) {
      uint64_t here = 0;
      for (size_t p = first; p < first + count; ++p)
        for (uint64_t left = active[p]; left != 0; left &= left - 1) {
          const auto i = static_cast<uint32_t>(std::countr_zero(left));
          ++here;
          if (SameEnd(expected[p], found[p], i, any, steps) && (any || IsPlaced(found[p], i))) continue;
          ++differences;
          const std::lock_guard lock(mutex);
          if (out_.first.size() < kMostListed)
            out_.first.push_back(fmt::format("{}: ray {}: CPU {} at {} waits {}, device {} at {} waits {}",
                                             by, p * RayPacket::kRays + i, expected[p].triangle[i],
                                             expected[p].hit_t[i], expected[p].waits_for[i],
                                             found[p].triangle[i], found[p].hit_t[i], found[p].waits_for[i]));
        }
      traced += here;
    });
    out_.differences += differences;
    out_.traced += traced;
  }

  /// Whether shading finds the triangle's other data by its voxel and its index there.
  bool IsPlaced(const RayPacket& rays, uint32_t i) {
    if (rays.triangle[i] == kNoTriangle) return true;
    const auto& voxels = scene_.resident().voxels();
    return rays.voxel[i] < voxels.size() && rays.local[i] < voxels[rays.voxel[i]].triangle_count &&
           voxels[rays.voxel[i]].triangle_ids[rays.local[i]] == rays.triangle[i];
  }

  static std::string By(const GpuWay& way, cuda::Schedule schedule, const char* what, bool any) {
    return fmt::format("{} {} {} {}", way.name, Name(schedule), any ? "any" : "closest", what);
  }

  Status Trace(const cuda::DeviceScene& device, const GpuWay& way, cuda::Schedule schedule, bool any) {
    cuda::Launch launch{way.way, schedule, any, {}};
    // Few rays a warp and many, so that all of its branches are come to.
    launch.limits = kLimits[limits_++ % std::size(kLimits)];
    QUARRY_ASSIGN(const double seconds, cuda::Trace(device, rays_, launch));
    (void)seconds;
    return {};
  }

  /// All voxels are there. Any-hit rays end half way.
  Status CheckBatch(bool any, const std::vector<uint64_t>& active) {
    start_[any] = fresh_;
    if (any)
      for (RayPacket& packet : start_[1])
        for (uint32_t i = 0; i < RayPacket::kRays; i += 2)
          packet.hit_t[i] = Length(scene_.resident().catalog().meta) * 0.25f;
    active_ = active;
    QUARRY_TRY(CheckAllThere(start_[any], any, ""));
    if (!any)
      for (const RayPacket& packet : expected_)
        out_.hits += static_cast<uint64_t>(std::count_if(packet.triangle, packet.triangle + RayPacket::kRays,
                                                         [](uint32_t id) { return id != kNoTriangle; }));
    ends_[any] = expected_;
    return {};
  }

  static float Length(const SceneMeta& meta) {
    const glm::vec3 d = meta.root_upper - meta.root_lower;
    return std::max({d.x, d.y, d.z});
  }

  /// The active rays of `from` by every kernel. Leaves the CPU's results in expected_.
  Status CheckAllThere(const Packets& from, bool any, const char* what) {
    const Kernel& best = BestKernel(Grouping::kWide);
    expected_ = from;
    TraceInParallel(scene_.resident().view(), any ? best.any : best.closest, expected_, active_);
    QUARRY_TRY(rays_.Put(from));
    QUARRY_TRY(rays_.Choose(ListRays(active_.data(), static_cast<uint32_t>(active_.size()))));
    Packets found(from.size());
    for (const GpuWay& way : kGpuWays) {
      Packets steps = from;
      const Variant& same = CpuKernelOf(way);
      TraceInParallel(scene_.view(way), any ? same.any : same.closest, steps, active_);
      for (const cuda::Schedule schedule : kSchedules) {
        QUARRY_TRY(rays_.Reset());
        QUARRY_TRY(Trace(scene_.device(way), way, schedule, any));
        QUARRY_TRY(rays_.Get(found));
        Compare(expected_, found, active_, any, false, By(way, schedule, what, any));
        Compare(steps, found, active_, any, true, By(way, schedule, "same steps", any));
      }
    }
    return {};
  }

  /// From the nearest hits on to the next ones.
  Status CheckGoingOn() {
    Packets from = ends_[0];
    for (size_t p = 0; p < from.size(); ++p) {
      active_[p] = 0;
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        if (from[p].triangle[i] == kNoTriangle) continue;
        from[p].GoOnAfterHit(i, kInfinity);
        active_[p] |= uint64_t{1} << i;
      }
    }
    return CheckAllThere(from, false, "going on");
  }

  /// Half of the voxels are uploaded; when rays wait for others, the other half.
  Status CheckHalves(const GpuWay& way, bool any) {
    QUARRY_ASSIGN(cuda::DeviceScene device, scene_.Empty(way));
    QUARRY_TRY(device.Upload(scene_.Voxels(way, 2, 0)));
    QUARRY_TRY(rays_.Put(start_[any]));
    active_.assign(packets_, ~uint64_t{0});
    QUARRY_TRY(rays_.Choose(ListRays(active_.data(), packets_)));
    QUARRY_TRY(Trace(device, way, cuda::Schedule::kPersistent, any));
    Packets found(packets_);
    QUARRY_TRY(rays_.Get(found));
    for (size_t p = 0; p < found.size(); ++p) {
      active_[p] = 0;
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        if (found[p].waits_for[i] == kNoVoxel) continue;
        active_[p] |= uint64_t{1} << i;
        ++out_.suspended;
        if (found[p].waits_for[i] % 2 == 0 && ++out_.differences && out_.first.size() < kMostListed)
          out_.first.push_back(fmt::format("{}: a ray waits for a voxel that is there", way.name));
      }
    }
    QUARRY_TRY(device.Upload(scene_.Voxels(way, 2, 1)));
    QUARRY_TRY(rays_.Choose(ListRays(active_.data(), packets_)));
    QUARRY_TRY(Trace(device, way, cuda::Schedule::kPersistent, any));
    QUARRY_TRY(rays_.Get(found));
    active_.assign(packets_, ~uint64_t{0});
    Compare(ends_[any], found, active_, any, false,
            By(way, cuda::Schedule::kPersistent, "uploaded in halves", any));
    return {};
  }

  /// Few rays, each voxel absent at first: test::TraceSuspending() on the device, the CPU beside it.
  Status CheckSuspended(const GpuWay& way, bool any) {
    const auto voxels = static_cast<uint32_t>(scene_.resident().voxels().size());
    cuda::DeviceScene& device = scene_.device(way);
    const Variant& same = CpuKernelOf(way);
    const TraceFunction trace = any ? same.any : same.closest;
    std::vector<uint8_t> resident(voxels, 0);
    active_.assign(few_, ~uint64_t{0});
    Packets on_cpu(start_[any].begin(), start_[any].begin() + few_), found(few_);
    QUARRY_TRY(rays_.Put(on_cpu));
    for (uint32_t round = 0;; ++round) {
      const cuda::Schedule schedule = kSchedules[round % std::size(kSchedules)];
      QUARRY_TRY(device.SetResident(resident));
      QUARRY_TRY(rays_.Choose(ListRays(active_.data(), few_)));
      QUARRY_TRY(Trace(device, way, schedule, any));
      QUARRY_TRY(rays_.Get(found));
      Residency residency{&scene_.view(way), &resident};
      InParallel(few_, [&](size_t first, size_t count) {
        trace(scene_.view(way).top(), {Residency::Find, &residency}, on_cpu.data() + first,
              active_.data() + first, static_cast<uint32_t>(count));
      });
      Compare(on_cpu, found, active_, any, true, By(way, schedule, "suspended", any));
      if (!Grant(found, round, resident)) break;
      // A device that is wrong may go back and forth: no ray waits more often than there are voxels.
      if (round > 3 * voxels + 3) return Fail(fmt::format("{}: rays wait for ever", way.name));
    }
    resident.assign(voxels, 1);
    QUARRY_TRY(device.SetResident(resident));
    active_.assign(few_, ~uint64_t{0});
    Compare(ends_[any], found, active_, any, false, By(way, cuda::Schedule::kPersistent, "after waits", any));
    return {};
  }

  struct Residency {
    const test::SceneView* view;
    const std::vector<uint8_t>* resident;

    static const VoxelGeometry* Find(void* context, uint32_t voxel) {
      const auto& self = *static_cast<const Residency*>(context);
      return (*self.resident)[voxel] != 0 ? &self.view->voxels()[voxel] : nullptr;
    }
  };

  /// Sets active_ to the rays that wait, and makes a third of their voxels resident. False: no ray waits.
  bool Grant(const Packets& found, uint32_t round, std::vector<uint8_t>& resident) {
    resident.assign(resident.size(), 0);
    bool waits = false;
    for (size_t p = 0; p < found.size(); ++p) {
      const uint64_t traced = std::exchange(active_[p], 0);
      for (uint64_t left = traced; left != 0; left &= left - 1) {
        const auto i = static_cast<uint32_t>(std::countr_zero(left));
        const uint32_t voxel = found[p].waits_for[i];
        if (voxel == kNoVoxel) continue;
        active_[p] |= uint64_t{1} << i;
        if (!waits || voxel % 3 == round % 3) resident[voxel] = 1;
        waits = true;
        ++out_.suspended;
      }
    }
    return waits;
  }

  static constexpr WarpLimits kLimits[] = {{20, 0}, {1, 0}, {32, 0}, {24, 8}, {12, 31}};

  GpuScene& scene_;
  const uint32_t packets_, few_;  ///< of a batch, and of these the ones that suspend again and again
  cuda::DeviceRays rays_;
  std::mt19937 random_{77};
  Packets fresh_, expected_, start_[2], ends_[2];  ///< [1]: of any-hit rays
  std::vector<uint64_t> active_;
  uint32_t limits_ = 0;
  GpuCheck out_;
};

}  // namespace

Result<GpuCheck> CheckOnDevice(GpuScene& scene, uint64_t rays, double seconds, uint32_t batch) {
  return DeviceCheck(scene, batch).Run(rays, seconds);
}

}  // namespace quarry::bench
