#include "common/engine/ask_rays.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

namespace quarry {

Result<RayAnswers> AskRays(Renderer& renderer, std::vector<RayQuery> rays, const Renderer::RayAsk& ask,
                           std::stop_token stop, const View& view) {
  if (rays.size() > kMostRaysOfCall) return BadUsage(fmt::format("more than {} rays", kMostRaysOfCall));
  const bool all = ask.goal == RayGoal::kAll, one_each = !all && ask.goal != RayGoal::kCount;
  const size_t count = rays.size();
  const RayVector array(std::move(rays));
  QUARRY_TRY(array.Check(0, count));
  RayAnswers answers;
  if (one_each) answers.hits.resize(count);
  if (one_each && ask.surfaces && ask.goal == RayGoal::kNearest) answers.surfaces.resize(count);
  if (!one_each) answers.counts.resize(count);
  std::map<size_t, RenderedTile> of_parts;  // with kAll, by first ray
  const Renderer::OnRays keep = [&](size_t at, const RenderedTile& result) {
    const auto first = static_cast<std::ptrdiff_t>(at);
    std::ranges::copy(result.counts, answers.counts.begin() + (one_each ? 0 : first));
    if (all) {
      of_parts[at] = result;
    } else if (one_each) {
      std::ranges::copy(result.hits, answers.hits.begin() + first);
      std::ranges::copy(result.surfaces, answers.surfaces.begin() + (answers.surfaces.empty() ? 0 : first));
    }
  };
  QUARRY_TRY(renderer.Ask(array, count, ask, keep, std::move(stop), view));
  size_t hits = 0, surfaces = 0;
  for (const auto& [first, of_part] : of_parts)
    hits += of_part.hits.size(), surfaces += of_part.surfaces.size();
  answers.hits.reserve(answers.hits.size() + hits);
  answers.surfaces.reserve(answers.surfaces.size() + surfaces);
  for (auto& [first, of_part] : of_parts) {
    answers.hits.insert(answers.hits.end(), of_part.hits.begin(), of_part.hits.end());
    answers.surfaces.insert(answers.surfaces.end(), of_part.surfaces.begin(), of_part.surfaces.end());
    of_part = {};
  }
  return answers;
}

Result<std::vector<Hit>> HitsOf(Renderer& renderer, std::vector<RayQuery> rays, RayGoal goal,
                                std::stop_token stop, const View& view) {
  QUARRY_ASSIGN(RayAnswers answers, AskRays(renderer, std::move(rays), {.goal = goal, .from_origin = true},
                                            std::move(stop), view));
  return std::move(answers.hits);
}

}  // namespace quarry
