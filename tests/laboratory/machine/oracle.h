#pragma once

#include <cstdint>

#include "tests/laboratory/machine/ray_state.h"

namespace quarry::laboratory {

/// How the multipass machine chooses the kernel of the next pass while rays are in the structure.
enum class OracleKind {
  kAny,     ///< intersects as soon as any ray has a list (the simple algorithm of Purcell et al. 2002, 3.2)
  kShare,   ///< intersects once a share of the rays under way has a list (the same section: 20 %)
  kDelany,  ///< the kernel with most rays (Delany 1988)
  kFoley,   ///< stays with a kernel until another has more than twice its rays (Foley & Sugerman 2005, 3.4)
};
inline constexpr uint32_t kOracles = 4;
inline constexpr const char* kOracleNames[kOracles] = {"any", "share", "delany", "foley"};

struct Oracle {
  OracleKind kind = OracleKind::kShare;
  double share = 0.2;  ///< of kShare, in (0, 1]
};

/// Rays in each stage, as a counter over the stencil buffer gives them.
struct StageCounts {
  uint32_t of[kStages] = {};

  uint32_t operator[](Stage stage) const { return of[static_cast<uint32_t>(stage)]; }
  uint32_t& operator[](Stage stage) { return of[static_cast<uint32_t>(stage)]; }
  uint32_t in_structure() const {
    return (*this)[Stage::kTraverse] + (*this)[Stage::kUp] + (*this)[Stage::kIntersect];
  }
};

/// The stage whose kernel runs next: kTraverse, kUp or kIntersect. `last`: the kernel of the last pass. Of
/// equal counts the first in that order is chosen. Requires: a ray is in one of the three. Thread-safe.
Stage ChooseStage(const Oracle& oracle, const StageCounts& counts, Stage last);

}  // namespace quarry::laboratory
