#include "worker/sources/source_policy.h"

#include <algorithm>
#include <cmath>

#include "common/math/random.h"

namespace quarry {

std::vector<uint32_t> HomeOrder(uint32_t block, std::span<const uint64_t> keys) {
  std::vector<std::pair<uint64_t, uint32_t>> weights;
  for (uint32_t i = 0; i < keys.size(); ++i)
    weights.push_back({Mix64(keys[i] ^ Mix64(block + 0x9E3779B97F4A7C15ull)), i});
  std::sort(weights.begin(), weights.end(), std::greater<>());
  std::vector<uint32_t> order;
  for (const auto& [weight, i] : weights) order.push_back(i);
  return order;
}

void BackOff::Failed(double now_s) {
  const double wait_s = std::min(kMostS, kLeastS * std::exp2(std::min(failures_, 16u)));
  ++failures_;
  const auto chance = static_cast<double>(Mix64(seed_ + failures_) >> 11) * 0x1p-53;
  open_at_s_ = now_s + wait_s * (1 - 0.25 * chance);
}

bool RetryBudget::Spend(double now_s) {
  tokens_ = std::min(kMost, tokens_ + std::max(0.0, now_s - filled_at_s_) * kEachSecond);
  filled_at_s_ = now_s;
  if (tokens_ < 1) return false;
  tokens_ -= 1;
  return true;
}

void AnswerTime::Add(double s) {
  const double error = s - mean_s_;
  mean_s_ = any_ ? mean_s_ + error / 8 : s;
  deviation_s_ = any_ ? deviation_s_ + (std::abs(error) - deviation_s_) / 4 : s / 2;
  any_ = true;
}

double AnswerTime::HedgeAfterS() const { return std::max(kLeastHedgeS, mean_s_ + 4 * deviation_s_); }

int ChooseSource(std::span<const uint32_t> order, std::span<const SourceView> sources) {
  int best = -1;
  for (const uint32_t i : order) {
    if (!sources[i].open) continue;
    const double best_s = best < 0 ? 0 : sources[static_cast<size_t>(best)].mean_answer_s;
    if (best < 0 || best_s > std::max(2 * sources[i].mean_answer_s, sources[i].mean_answer_s + kWorthS))
      best = static_cast<int>(i);
  }
  return best;
}

}  // namespace quarry
