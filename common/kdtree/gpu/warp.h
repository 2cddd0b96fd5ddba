#pragma once

#include <atomic>
#include <bit>
#include <cstdint>

#include "common/math/host_device.h"

// Warps: 32 lanes that take each step together. A kernel for warps is a template over one of the two classes
// below, so that the CPU runs the same code as the GPU:
//   PerLane<T>       a T for each lane
//   ForEach(m, f)    calls f(lane) for the lanes of `m`
//   Ballot(f)        the lanes for which f(lane) holds, as bits; all lanes get it
//   FetchAdd(p, n)   adds n to *p, once for the warp; all lanes get the value before
// Control flow depends only on values that all lanes know: all lanes reach each Ballot.

namespace quarry {

inline constexpr uint32_t kWarpLanes = 32;

/// The number of lanes of `lanes` below `lane`.
QUARRY_HOST_DEVICE inline uint32_t RankIn(uint32_t lanes, uint32_t lane) {
  return static_cast<uint32_t>(std::popcount(lanes & ((1u << lane) - 1)));
}

/// A warp on the CPU: lanes take a step one after the other. Counts how many lanes its steps have had.
class EmulatedWarp {
 public:
  template <class T>
  class PerLane {
   public:
    T& operator[](uint32_t lane) { return values_[lane]; }

   private:
    T values_[kWarpLanes] = {};
  };

  template <class F>
  void ForEach(uint32_t lanes, const F& f) {
    ++steps_;
    lane_steps_ += static_cast<uint64_t>(std::popcount(lanes));
    for (; lanes != 0; lanes &= lanes - 1) f(static_cast<uint32_t>(std::countr_zero(lanes)));
  }

  template <class F>
  uint32_t Ballot(const F& f) const {
    uint32_t lanes = 0;
    for (uint32_t lane = 0; lane < kWarpLanes; ++lane) lanes |= f(lane) ? 1u << lane : 0;
    return lanes;
  }

  uint32_t FetchAdd(uint32_t* counter, uint32_t n) const {
    return std::atomic_ref<uint32_t>(*counter).fetch_add(n, std::memory_order_relaxed);
  }

  uint64_t steps() const { return steps_; }
  /// Lanes that have had a part in steps, together: of steps() * kWarpLanes.
  uint64_t lane_steps() const { return lane_steps_; }

 private:
  uint64_t steps_ = 0, lane_steps_ = 0;
};

#ifdef __CUDACC__
/// The warp of the calling thread. Requires: a block of one dimension, of whole warps.
class DeviceWarp {
 public:
  template <class T>
  class PerLane {
   public:
    QUARRY_HOST_DEVICE T& operator[](uint32_t) { return value_; }

   private:
    T value_ = {};
  };

#ifdef __CUDA_ARCH__
  QUARRY_HOST_DEVICE DeviceWarp() : lane_(threadIdx.x % kWarpLanes) {}

  template <class F>
  QUARRY_HOST_DEVICE void ForEach(uint32_t lanes, const F& f) const {
    if ((lanes >> lane_ & 1) != 0) f(lane_);
  }

  template <class F>
  QUARRY_HOST_DEVICE uint32_t Ballot(const F& f) const {
    return __ballot_sync(kAll, f(lane_));
  }

  QUARRY_HOST_DEVICE uint32_t FetchAdd(uint32_t* counter, uint32_t n) const {
    uint32_t before = 0;
    if (lane_ == 0) before = atomicAdd(counter, n);
    return __shfl_sync(kAll, before, 0);
  }

 private:
  static constexpr uint32_t kAll = 0xFFFFFFFFu;
  uint32_t lane_;
#else
  // The compiler's pass for the CPU only needs the names.
  template <class F>
  QUARRY_HOST_DEVICE void ForEach(uint32_t, const F&) const {}
  template <class F>
  QUARRY_HOST_DEVICE uint32_t Ballot(const F&) const {
    return 0;
  }
  QUARRY_HOST_DEVICE uint32_t FetchAdd(uint32_t*, uint32_t) const { return 0; }
#endif
};
#endif

}  // namespace quarry
