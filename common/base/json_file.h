#pragma once

#include <cstdint>
#include <initializer_list>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// Upper limits for a JSON text, which may come from strangers.
struct JsonLimits {
  uint64_t bytes = 64u << 20;   ///< bytes of text
  uint32_t depth = 64;          ///< nesting depth of arrays and objects
  uint64_t values = 4u << 20;   ///< values in all; each takes 16 to 100 bytes of memory
  uint64_t members = 1u << 20;  ///< members of one object; ordered objects search theirs linearly
};

/// JSON with single-precision floats and members in file order.
using FloatJson =
    nlohmann::basic_json<nlohmann::ordered_map, std::vector, std::string, bool, int64_t, uint64_t, float>;

/// Parses `text` without recursion; throws nothing. `name` is the file's name in messages. Json is
/// nlohmann::json, nlohmann::ordered_json or FloatJson.
/// Errors: invalid JSON (names the byte); a limit exceeded; a number that Json cannot hold (names its key).
/// Thread-safe.
template <class Json>
Result<Json> ParseJson(std::string_view text, const std::string& name, const JsonLimits& limits = {});

/// Parses a regular file. Errors: as ParseJson(); the file cannot be read. Thread-safe.
template <class Json>
Result<Json> ReadJsonFile(const std::string& path, const JsonLimits& limits = {});

/// A value of a JSON file together with its place for messages: "FILE: frames[3].eye: TEXT". Holds
/// references: `value` and `file` outlive it. Thread-safe.
class JsonValue {
 public:
  JsonValue(const nlohmann::json& value, const std::string& file, std::string key = "")
      : value_(&value), file_(&file), key_(std::move(key)) {}

  /// The member `name`. Errors: not an object; no such member.
  Result<JsonValue> Member(const char* name) const;
  /// The member `name`, or nothing when there is none. Errors: not an object.
  Result<std::optional<JsonValue>> Optional(const char* name) const;
  /// Errors: not an object; an object with a member of another name, which the error names.
  Status HasOnly(std::initializer_list<const char*> names) const;
  /// The elements of an array. Errors: not an array.
  Result<std::vector<JsonValue>> List() const;
  /// Errors: not a number.
  Result<double> Number() const;
  /// Errors: neither true nor false.
  Result<bool> Flag() const;
  /// Errors: not a whole number of at least 0.
  Result<uint64_t> Whole() const;
  /// Reads an array of out.size() numbers. Errors: not such an array; a number outside [least, most].
  Status Numbers(std::span<double> out, double least, double most) const;
  bool is_null() const;
  /// Errors: not a string.
  Result<std::string> Text() const;

  /// Makes the error about this value: the file, the value's place in it, then `what`.
  tl::unexpected<Error> Wrong(const std::string& what) const;

 private:
  const nlohmann::json* value_;
  const std::string* file_;
  std::string key_;
};

}  // namespace quarry
