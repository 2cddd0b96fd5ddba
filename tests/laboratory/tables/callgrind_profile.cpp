#include <fmt/format.h>

#include <charconv>
#include <optional>
#include <unordered_map>

#include "tests/laboratory/tables/callgrind.h"

namespace quarry::laboratory {

namespace {

std::vector<std::string_view> Words(std::string_view line) {
  std::vector<std::string_view> words;
  while (true) {
    const size_t begin = line.find_first_not_of(" \t");
    if (begin == std::string_view::npos) return words;
    const size_t end = std::min(line.find_first_of(" \t", begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    line.remove_prefix(end);
  }
}

std::optional<uint64_t> Number(std::string_view text) {
  uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// Costs of every function, by its demangled name.
using Costs = std::unordered_map<std::string, FunctionCost>;

/// Reads line by line. No position is needed to find a cost's function, so that relative positions are only
/// counted.
class ProfileReader {
 public:
  explicit ProfileReader(const std::string& name) : name_(name) {}

  Status Read(std::string_view profile) {
    while (!profile.empty()) {
      const size_t end = std::min(profile.find('\n'), profile.size());
      ++line_;
      QUARRY_TRY(ReadLine(profile.substr(0, end)));
      profile.remove_prefix(std::min(end + 1, profile.size()));
    }
    if (next_ != Next::kOwn) return Broken("the profile ends within a call");
    if (!total_) return Broken("the profile has no total");
    if (*total_ != own_)
      return Broken(fmt::format("the functions have {} instructions, and the total is {}", own_, *total_));
    return {};
  }

  const Costs& costs() const { return costs_; }

 private:
  /// The kind of the next line of costs.
  enum class Next { kOwn, kCall, kJump };

  tl::unexpected<Error> Broken(const std::string& reason) const {
    return Fail(fmt::format("{}: line {}: {}", name_, line_, reason));
  }

  Status ReadLine(std::string_view line) {
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    if (line.empty() || line.front() == '#') return {};
    if (std::string_view("0123456789+-*").find(line.front()) != std::string_view::npos)
      return ReadCosts(line);
    const size_t colon = line.find(':'), equals = line.find('=');
    if (equals < colon) return ReadSpecification(line.substr(0, equals), line.substr(equals + 1));
    if (colon != std::string_view::npos) return ReadHeader(line.substr(0, colon), line.substr(colon + 1));
    return Broken("neither costs nor a name");
  }

  Status ReadHeader(std::string_view key, std::string_view value) {
    const auto words = Words(value);
    if (key == "positions") positions_ = words.size();
    if (key == "events") {
      instructions_at_.reset();
      for (size_t i = 0; i < words.size(); ++i)
        if (words[i] == "Ir") instructions_at_ = i;
      if (!instructions_at_) return Broken("the profile does not count instructions (Ir)");
    }
    // "summary" stands at the head, "totals" at the end; both are the sum of own costs.
    if (key == "totals" || (key == "summary" && !total_)) {
      if (!instructions_at_ || *instructions_at_ >= words.size() || !Number(words[*instructions_at_]))
        return Broken("a total without instructions");
      total_ = Number(words[*instructions_at_]);
    }
    return {};
  }

  /// The name of "(id) name", which later lines call "(id)", or the text itself. Null: the id is new.
  std::optional<std::string> Name(std::string_view text) {
    const size_t close = text.find(')');
    if (text.empty() || text.front() != '(' || close == std::string_view::npos ||
        !Number(text.substr(1, close - 1)))
      return std::string(text);
    const std::string id(text.substr(1, close - 1));
    if (close + 1 < text.size() && text[close + 1] == ' ') names_[id] = std::string(text.substr(close + 2));
    const auto found = names_.find(id);
    if (found == names_.end()) return std::nullopt;
    return found->second;
  }

  Status ReadSpecification(std::string_view key, std::string_view value) {
    if (key == "fn" || key == "cfn") {
      const auto name = Name(value);
      if (!name) return Broken(fmt::format("function {} has no name yet", value));
      (key == "fn" ? function_ : callee_) = &costs_[*name];
    } else if (key == "calls") {
      const auto words = Words(value);
      const auto calls = words.empty() ? std::nullopt : Number(words[0]);
      if (!calls || !callee_) return Broken("calls without a number or a function");
      callee_->calls += *calls;
      next_ = Next::kCall;
    } else if (key == "jump" || key == "jcnd") {
      next_ = Next::kJump;
    }
    return {};  // files and objects (fl, fi, fe, ob, cfi, cfl, cob) do not matter here
  }

  /// Positions, then costs, of which the last may be missing: they are 0.
  Status ReadCosts(std::string_view line) {
    const Next what = next_;
    next_ = Next::kOwn;
    if (what == Next::kJump) return {};
    const auto words = Words(line);
    if (!instructions_at_) return Broken("costs before the names of events");
    if (!function_) return Broken("costs of no function");
    if (words.size() < positions_) return Broken("costs without a position");
    const size_t at = positions_ + *instructions_at_;
    if (at >= words.size()) return {};
    const auto cost = Number(words[at]);
    if (!cost) return Broken("a cost that is no number");
    // The callee's inclusive cost, as part of the caller's: a callee's own lines hold it a second time.
    function_->instructions += *cost;
    if (what == Next::kOwn) own_ += *cost;
    return {};
  }

  std::string name_;
  uint64_t line_ = 0;
  size_t positions_ = 1;
  std::optional<size_t> instructions_at_;
  std::unordered_map<std::string, std::string> names_;
  Costs costs_;
  FunctionCost* function_ = nullptr;  // elements of an unordered_map stay where they are
  FunctionCost* callee_ = nullptr;
  Next next_ = Next::kOwn;
  uint64_t own_ = 0;
  std::optional<uint64_t> total_;
};

}  // namespace

Result<FunctionCosts> ReadCallgrindProfile(std::string_view profile, const std::string& name,
                                           std::span<const std::string> functions) {
  ProfileReader reader(name);
  QUARRY_TRY(reader.Read(profile));
  FunctionCosts costs;
  for (const std::string& function : functions) {
    FunctionCost& sum = costs[function];
    sum = {};
    const auto exact = reader.costs().find(function);
    if (exact != reader.costs().end()) {
      sum = exact->second;
      continue;
    }
    for (const auto& [full, cost] : reader.costs()) {
      if (full.find(function) == std::string::npos) continue;
      sum.calls += cost.calls;
      sum.instructions += cost.instructions;
    }
  }
  return costs;
}

}  // namespace quarry::laboratory
