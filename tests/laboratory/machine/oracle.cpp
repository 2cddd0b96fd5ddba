#include "tests/laboratory/machine/oracle.h"

#include <algorithm>
#include <initializer_list>

#include "common/base/check.h"

namespace quarry::laboratory {

namespace {

Stage Largest(const StageCounts& counts, std::initializer_list<Stage> stages) {
  return *std::ranges::max_element(stages, {}, [&](Stage stage) { return counts[stage]; });
}

}  // namespace

Stage ChooseStage(const Oracle& oracle, const StageCounts& counts, Stage last) {
  const uint32_t all = counts.in_structure(), waiting = counts[Stage::kIntersect];
  QUARRY_CHECK(all > 0);
  const Stage most = Largest(counts, {Stage::kTraverse, Stage::kUp, Stage::kIntersect});
  switch (oracle.kind) {
    case OracleKind::kAny:
      if (waiting > 0) return Stage::kIntersect;
      break;
    case OracleKind::kShare:
      if (waiting == all || static_cast<double>(waiting) >= oracle.share * all) return Stage::kIntersect;
      break;
    case OracleKind::kDelany:
      return most;
    case OracleKind::kFoley:
      if (last != Stage::kTraverse && last != Stage::kUp && last != Stage::kIntersect) return most;
      return counts[last] > 0 && counts[most] <= 2 * uint64_t{counts[last]} ? last : most;
  }
  return Largest(counts, {Stage::kTraverse, Stage::kUp});
}

}  // namespace quarry::laboratory
