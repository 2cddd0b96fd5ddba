#include "preprocess/import/threemf/instance_graph.h"

#include <algorithm>

namespace quarry {

bool InstanceGraph::IsShownByBuild() const {
  return std::ranges::any_of(uses_, [](const Use& use) { return use.user == kBuild; });
}

void InstanceGraph::ShowAll(uint32_t objects) {
  std::vector<bool> used(objects);
  for (const Use& use : uses_) used[use.object] = true;
  for (uint32_t i = 0; i < objects; ++i)
    if (!used[i]) uses_.push_back({i, kBuild, glm::dmat4(1)});
}

std::optional<uint32_t> InstanceGraph::Count(uint32_t objects) {
  constexpr double kMostCount = 0x1p53;
  std::ranges::stable_sort(uses_, {}, &Use::object);
  first_.assign(objects + size_t{1}, 0);
  std::vector<uint32_t> users(objects), depth(objects, 1);
  std::vector<std::vector<uint32_t>> used_by(objects);
  for (const Use& use : uses_) {
    ++first_[use.object + size_t{1}];
    if (use.user == kBuild) continue;
    ++users[use.object];
    used_by[use.user].push_back(use.object);
  }
  for (uint32_t i = 0; i < objects; ++i) first_[i + size_t{1}] += first_[i];
  counts_.assign(objects, 0);
  for (const Use& use : uses_)
    if (use.user == kBuild) counts_[use.object] += 1;
  // Users come before the objects that they use.
  std::vector<uint32_t> ready;
  for (uint32_t i = 0; i < objects; ++i)
    if (users[i] == 0) ready.push_back(i);
  for (size_t at = 0; at < ready.size(); ++at)
    for (const uint32_t object : used_by[ready[at]]) {
      counts_[object] = std::min(counts_[object] + counts_[ready[at]], kMostCount);
      depth[object] = std::max(depth[object], depth[ready[at]] + 1);
      if (depth[object] > kMostDepth) return object;
      if (--users[object] == 0) ready.push_back(object);
    }
  for (uint32_t i = 0; i < objects; ++i)
    if (users[i] != 0) return i;
  return std::nullopt;
}

Status InstanceGraph::ForEach(uint32_t object, const Visit& visit) const {
  std::vector<uint32_t> way{object};
  return Climb(glm::dmat4(1), way, visit);
}

/// Continues from the last object of the way; kMostDepth bounds the recursion.
Status InstanceGraph::Climb(const glm::dmat4& to_here, std::vector<uint32_t>& way, const Visit& visit) const {
  const uint32_t object = way.back();
  for (uint32_t i = first_[object]; i < first_[object + size_t{1}]; ++i) {
    const Use& use = uses_[i];
    const glm::dmat4 to_user = use.transform * to_here;
    if (use.user == kBuild) {
      QUARRY_TRY(visit(to_user, way));
    } else if (counts_[use.user] > 0) {
      way.push_back(use.user);
      QUARRY_TRY(Climb(to_user, way, visit));
      way.pop_back();
    }
  }
  return {};
}

}  // namespace quarry
