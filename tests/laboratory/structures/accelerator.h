#pragma once

#include <concepts>
#include <cstdint>
#include <type_traits>

#include "tests/laboratory/memory.h"

// The machine's interface to an acceleration structure: four short kernels over one ray. A ray's part of the
// structure is `Constant`, written once by Setup, and `State`, which each step reads and writes.

namespace quarry::laboratory {

/// Where a kernel has taken a ray.
enum class StepOutcome : uint32_t {
  kOn,    ///< Step comes next
  kUp,    ///< Up comes next
  kList,  ///< to triangles, or to none: they are to be tested, then comes Leave
  kOut,   ///< out of the structure: the ray's hit, if any, is final
};

/// Triangles to test: entries `next` to `end` of the structure's list texture.
struct TriangleRange {
  uint32_t next = 0, end = 0;
};

/// A ray of the machine. t in multiples of |direction|.
struct RayStart {
  float origin[3];
  float direction[3];
};

/// An acceleration structure. Its kernels are const, thread-safe, and read memory through M only.
///   Setup  clips the ray to the scene, from t up to t_end, and begins.
///   Step   goes on by one cell or node; sets the range when it returns kList.
///   Up     goes up by one node; only where kGoesUp.
///   Leave  leaves a list that is tested; `best_t` is the ray's nearest hit so far, or its end. It must not
///          return kOut while a hit before best_t may lie ahead: with best_t equal to the exit it goes on.
template <class A, class M = PlainMemory>
concept Accelerator = requires(const A& a, M& memory, const RayStart& ray, typename A::Constant& constant,
                               typename A::State& state, TriangleRange& range, float t) {
  requires std::is_trivially_copyable_v<typename A::Constant>;
  requires std::is_trivially_copyable_v<typename A::State>;
  { A::kGoesUp } -> std::convertible_to<bool>;
  { a.Setup(memory, ray, t, t, constant, state) } -> std::same_as<StepOutcome>;
  { a.Step(memory, constant, state, range) } -> std::same_as<StepOutcome>;
  { a.Up(memory, constant, state) } -> std::same_as<StepOutcome>;
  { a.Leave(memory, constant, state, t) } -> std::same_as<StepOutcome>;
  { a.list() } -> std::same_as<const Texture<uint32_t>&>;
};

}  // namespace quarry::laboratory
