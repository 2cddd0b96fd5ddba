#include "common/base/json_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/file.h"
#include "common/base/size.h"

namespace quarry {
namespace {

constexpr size_t kLongestKeyShown = 60;  // characters

/// The member's name for messages: unprintable characters become '?', long names are cut.
std::string MemberKey(const std::string& name) {
  std::string shown;
  for (const char c : name.substr(0, kLongestKeyShown)) shown += c >= ' ' && c <= '~' ? c : '?';
  return shown;
}

std::string Below(const std::string& key, const std::string& member) {
  return key.empty() ? MemberKey(member) : key + "." + MemberKey(member);
}

/// Builds the value from the parser's events and stops at the limits. The events need no recursion.
template <class Json>
class Builder : public nlohmann::json_sax<Json> {
  using Sax = nlohmann::json_sax<Json>;

 public:
  explicit Builder(const JsonLimits& limits) : limits_(limits) {}

  bool null() override { return Add(nullptr) != nullptr; }
  bool boolean(bool value) override { return Add(value) != nullptr; }
  bool number_integer(typename Sax::number_integer_t value) override { return Add(value) != nullptr; }
  bool number_unsigned(typename Sax::number_unsigned_t value) override { return Add(value) != nullptr; }
  bool number_float(typename Sax::number_float_t value, const typename Sax::string_t&) override {
    return Add(value) != nullptr;
  }
  bool string(typename Sax::string_t& value) override { return Add(std::move(value)) != nullptr; }
  bool binary(typename Sax::binary_t&) override { return false; }
  bool start_object(size_t) override { return Open(Json::object()); }
  bool start_array(size_t) override { return Open(Json::array()); }
  bool end_object() override { return Close(); }
  bool end_array() override { return Close(); }
  bool key(typename Sax::string_t& name) override {
    open_.back().member = std::move(name);
    return true;
  }
  bool parse_error(size_t position, const std::string& token,
                   const nlohmann::json::exception& error) override {
    constexpr int kNumberOverflow = 406;  // the parser's id of this error
    if (error.id == kNumberOverflow)
      wrong = fmt::format("not readable as JSON: {} is the number {}, which is out of range", Where(),
                          MemberKey(token));
    else
      wrong = fmt::format("not valid JSON at byte {}{}; write the file again", position,
                          open_.empty() ? "" : ", in " + Where());
    return false;
  }

  Json root;
  std::string wrong;

 private:
  struct Container {
    Json* json;
    std::string member;  ///< the key read last
  };

  /// The place of the next value, as text for messages.
  std::string Where() const {
    std::string key;
    for (const Container& c : open_) {
      // the child being read is counted in size()
      const size_t complete = c.json->size() - (&c != &open_.back());
      key = c.json->is_array() ? fmt::format("{}[{}]", key, complete) : Below(key, c.member);
    }
    return key.empty() ? "the whole" : key;
  }

  template <class Value>
  Json* Add(Value&& value) {
    if (++values_ > limits_.values) {
      wrong = fmt::format("holds more than {} values, the most that is read", limits_.values);
      return nullptr;
    }
    if (open_.empty()) {
      root = Json(std::forward<Value>(value));
      return &root;
    }
    Json& parent = *open_.back().json;
    if (parent.is_array()) {
      parent.push_back(Json(std::forward<Value>(value)));
      return &parent.back();
    }
    if (parent.size() >= limits_.members) {
      wrong = fmt::format("holds an object of more than {} members, the most that is read", limits_.members);
      return nullptr;
    }
    Json& place = parent[open_.back().member];
    place = Json(std::forward<Value>(value));
    return &place;
  }

  bool Open(Json&& container) {
    if (open_.size() >= limits_.depth) {
      wrong = fmt::format("holds values nested deeper than {}, the most that is read", limits_.depth);
      return false;
    }
    Json* const place = Add(std::move(container));
    if (!place) return false;
    open_.push_back({place, {}});
    return true;
  }

  bool Close() {
    open_.pop_back();
    return true;
  }

  const JsonLimits& limits_;
  std::vector<Container> open_;
  uint64_t values_ = 0;
};

}  // namespace

template <class Json>
Result<Json> ParseJson(std::string_view text, const std::string& name, const JsonLimits& limits) {
  if (text.size() > limits.bytes)
    return Fail(fmt::format("{}: has {} of JSON, and at most {} is read", name, FormatSize(text.size()),
                            FormatSize(limits.bytes)));
  Builder<Json> builder(limits);
  try {
    if (Json::sax_parse(text.begin(), text.end(), &builder)) return Result<Json>(std::move(builder.root));
  } catch (const std::exception& e) {  // out of memory
    builder.wrong = fmt::format("not readable as JSON: {}", e.what());
  }
  return Fail(fmt::format("{}: {}", name, builder.wrong));
}

template <class Json>
Result<Json> ReadJsonFile(const std::string& path, const JsonLimits& limits) {
  QUARRY_ASSIGN(const InputFile file, InputFile::Open(path));
  if (file.size() > limits.bytes)
    return Fail(fmt::format("{}: has {} of JSON, and at most {} is read", path, FormatSize(file.size()),
                            FormatSize(limits.bytes)));
  Bytes bytes(file.size());
  QUARRY_TRY(file.ReadAt(0, bytes));
  return ParseJson<Json>(AsText(bytes), path, limits);
}

template Result<nlohmann::json> ParseJson(std::string_view, const std::string&, const JsonLimits&);
template Result<nlohmann::json> ReadJsonFile(const std::string&, const JsonLimits&);
template Result<nlohmann::ordered_json> ParseJson(std::string_view, const std::string&, const JsonLimits&);
template Result<FloatJson> ParseJson(std::string_view, const std::string&, const JsonLimits&);
template Result<FloatJson> ReadJsonFile(const std::string&, const JsonLimits&);

tl::unexpected<Error> JsonValue::Wrong(const std::string& what) const {
  return Fail(key_.empty() ? fmt::format("{}: {}", *file_, what)
                           : fmt::format("{}: {}: {}", *file_, key_, what));
}

Result<std::optional<JsonValue>> JsonValue::Optional(const char* name) const {
  if (!value_->is_object()) return Wrong("must be an object");
  const auto found = value_->find(name);
  if (found == value_->end()) return std::optional<JsonValue>();
  return std::optional<JsonValue>(JsonValue(*found, *file_, Below(key_, name)));
}

Result<JsonValue> JsonValue::Member(const char* name) const {
  QUARRY_ASSIGN(std::optional<JsonValue> found, Optional(name));
  if (!found) return Wrong(fmt::format("'{}' is missing", name));
  return *std::move(found);
}

Status JsonValue::HasOnly(std::initializer_list<const char*> names) const {
  if (!value_->is_object()) return Wrong("must be an object");
  for (const auto& [key, value] : value_->items())
    if (std::ranges::find(names, std::string_view(key)) == names.end())
      return Wrong(fmt::format("'{}' is not known; there are {}", key, fmt::join(names, ", ")));
  return {};
}

Result<bool> JsonValue::Flag() const {
  if (!value_->is_boolean()) return Wrong("must be true or false");
  return value_->get<bool>();
}

Result<uint64_t> JsonValue::Whole() const {
  if (!value_->is_number_unsigned()) return Wrong("must be a whole number of at least 0");
  return value_->get<uint64_t>();
}

Result<std::vector<JsonValue>> JsonValue::List() const {
  if (!value_->is_array()) return Wrong("must be a list");
  std::vector<JsonValue> list;
  for (size_t i = 0; i < value_->size(); ++i)
    list.emplace_back((*value_)[i], *file_, fmt::format("{}[{}]", key_, i));
  return list;
}

Result<double> JsonValue::Number() const {
  if (!value_->is_number()) return Wrong("must be a number");
  return value_->get<double>();
}

Status JsonValue::Numbers(std::span<double> out, double least, double most) const {
  constexpr const char* kCounts[] = {"no", "one", "two", "three", "four"};
  constexpr double kAny = 1e300;  // limits beyond it need no words
  const auto wrong = [&] {
    const std::string count =
        out.size() < std::size(kCounts) ? kCounts[out.size()] : fmt::format("{}", out.size());
    std::string example;
    for (size_t i = 0; i < out.size() && i < 4; ++i)
      example += fmt::format("{}{}", i == 0 ? "" : ", ", std::clamp(static_cast<double>(i + 1), least, most));
    const bool above = least > -kAny, below = most < kAny;
    const std::string range = above && below ? fmt::format(" from {:.3g} to {:.3g}", least, most)
                              : above        ? fmt::format(" of at least {:.3g}", least)
                              : below        ? fmt::format(" of at most {:.3g}", most)
                                             : "";
    return Wrong(fmt::format("must be {} numbers{}, like [{}{}]", count, range, example,
                             out.size() > 4 ? ", ..." : ""));
  };
  if (!value_->is_array() || value_->size() != out.size()) return wrong();
  for (size_t i = 0; i < out.size(); ++i) {
    const nlohmann::json& value = (*value_)[i];
    if (!value.is_number()) return wrong();
    out[i] = value.get<double>();
    if (!(out[i] >= least && out[i] <= most)) return wrong();
  }
  return {};
}

bool JsonValue::is_null() const { return value_->is_null(); }

Result<std::string> JsonValue::Text() const {
  if (!value_->is_string()) return Wrong("must be a text");
  return value_->get<std::string>();
}

}  // namespace quarry
