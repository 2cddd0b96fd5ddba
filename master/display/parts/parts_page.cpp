#include "master/display/parts/parts_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "common/remote/environment.h"
#include "master/display/page.h"

namespace quarry {
namespace {

using nlohmann::ordered_json;

/// Longest text of a search, in bytes.
constexpr size_t kMostText = 1000;

/// What a query asks for: exactly one of the first three.
struct Question {
  std::optional<uint32_t> parent;  ///< PartTree::kNone: parts without a parent
  std::optional<uint32_t> id;
  std::optional<std::string> find;
  uint32_t from = 0, count = 100;
};

Result<uint32_t> ReadNumber(std::string_view name, std::string_view text) {
  uint32_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (text.empty() || error != std::errc{} || end != text.data() + text.size() || number == PartTree::kNone)
    return BadUsage(fmt::format("'{}' of the request is not a number of parts", name));
  return number;
}

Status ReadMember(std::string_view name, std::string_view value, Question& question) {
  if (name == "find") {
    question.find = PercentDecodedText(value);
    if (question.find->empty() || question.find->size() > kMostText)
      return BadUsage(fmt::format("'find' of the request has not 1 to {} bytes", kMostText));
    return {};
  }
  if (name == "parent" && value == "none") return question.parent = PartTree::kNone, Status{};
  const bool known = name == "parent" || name == "id" || name == "from" || name == "count";
  if (!known) return BadUsage("the request has a member other than parent, id, find, from and count");
  QUARRY_ASSIGN(const uint32_t number, ReadNumber(name, value));
  if (name == "parent") question.parent = number;
  if (name == "id") question.id = number;
  if (name == "from") question.from = number;
  if (name == "count") question.count = std::min(number, PartsPage::kMost);
  return {};
}

Result<Question> ReadQuestion(std::string_view query, uint32_t parts) {
  Question question;
  while (!query.empty()) {
    const std::string_view member = query.substr(0, query.find('&'));
    query.remove_prefix(std::min(query.size(), member.size() + 1));
    const size_t equals = member.find('=');
    if (equals == std::string_view::npos) return BadUsage("the request has a member without a value");
    QUARRY_TRY(ReadMember(member.substr(0, equals), member.substr(equals + 1), question));
  }
  if (question.parent.has_value() + question.id.has_value() + question.find.has_value() != 1)
    return BadUsage("the request names none, or more than one, of parent, id and find");
  for (const auto& part : {question.parent, question.id})
    if (part && part != PartTree::kNone && *part >= parts)
      return BadUsage(fmt::format("there is no part {}; the scene has {}", *part, parts));
  return question;
}

ordered_json VectorOf(const glm::vec3& v, const glm::dvec3& offset) {
  return {v.x + offset.x, v.y + offset.y, v.z + offset.z};
}

ordered_json Describe(const PartTree& tree, uint32_t part, const glm::dvec3& offset) {
  const PartTree::Total total = tree.total(part);
  const uint32_t parent = tree[part].parent;
  ordered_json j{{"id", part},
                 {"name", tree.name(part)},
                 {"path", tree.Path(part)},
                 {"children", tree.child_count(part)},
                 {"triangles", nullptr},
                 {"box", nullptr},
                 {"closed", nullptr},
                 {"parent", nullptr}};
  if (!tree.has_tree()) return j;
  j["triangles"] = total.triangles;
  j["closed"] = (tree[part].flags & PartTree::Part::kClosed) != 0;
  if (total.lower.x <= total.upper.x)
    j["box"] = {VectorOf(total.lower, offset), VectorOf(total.upper, offset)};
  if (parent != PartTree::kNone) j["parent"] = parent;
  return j;
}

/// The place of a part among the children of its parent, which are in the order of their numbers.
uint32_t PlaceOf(const PartTree& tree, uint32_t part) {
  const uint32_t parent = tree[part].parent;
  uint32_t lower = 0, upper = tree.child_count(parent);
  while (upper - lower > 1) {
    const uint32_t middle = lower + (upper - lower) / 2;
    (tree.Children(parent, middle, 1).front() <= part ? lower : upper) = middle;
  }
  return lower;
}

/// The parts above a part, from the first level down, and the places of these and of the part itself.
void AddAncestors(const PartTree& tree, uint32_t part, ordered_json& j) {
  std::vector<uint32_t> ancestors, places{PlaceOf(tree, part)};
  for (uint32_t above = tree[part].parent; above != PartTree::kNone; above = tree[above].parent) {
    ancestors.push_back(above);
    places.push_back(PlaceOf(tree, above));
  }
  std::ranges::reverse(ancestors);
  std::ranges::reverse(places);
  j["ancestors"] = ancestors;
  j["places"] = places;
}

ordered_json AnswerTo(const Question& question, const PartTree& tree, const glm::dvec3& offset) {
  uint64_t total = 1;
  std::vector<uint32_t> parts;
  if (question.id) parts = {*question.id};
  if (question.parent) {
    total = tree.child_count(*question.parent);
    parts = tree.Children(*question.parent, question.from, question.count);
  }
  if (question.find) {
    PartTree::Found found = tree.Find(*question.find, question.from, question.count);
    total = found.total;
    parts = std::move(found.parts);
  }
  ordered_json j{{"total", total}, {"parts", ordered_json::array()}};
  for (const uint32_t part : parts) j["parts"].push_back(Describe(tree, part, offset));
  if (question.id) AddAncestors(tree, *question.id, j);
  return j;
}

}  // namespace

HttpResponse PartsPage::Answer(const HttpRequest& request) const {
  const auto tree = selections_.Parts();
  if (!tree) return Refused(500, tree.error().message);
  const auto question = ReadQuestion(request.query, (*tree)->size());
  if (!question) return Refused(400, question.error().message);
  ordered_json answer = AnswerTo(*question, **tree, offset_);
  if (question->id) {
    const auto attributes = selections_.AttributesOf(*question->id);
    if (!attributes) return Refused(500, attributes.error().message);
    if (!attributes->empty()) answer["parts"][0]["attributes"] = ordered_json::parse(*attributes);
  }
  return {.content_type = "application/json",
          .body = answer.dump(-1, ' ', false, ordered_json::error_handler_t::replace) + "\n"};
}

}  // namespace quarry
