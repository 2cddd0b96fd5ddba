#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// What a JSON text may be at most: it comes from strangers.
struct JsonLimits {
  uint64_t bytes = 64u << 20;   ///< of the text
  uint32_t depth = 64;          ///< of arrays and objects in one another
  uint64_t values = 4u << 20;   ///< in all; each takes 16 to 100 bytes of memory
  uint64_t members = 1u << 20;  ///< of one object; those in their order are found one by one
};

/// JSON with floats in single precision and members in their order.
using FloatJson =
    nlohmann::basic_json<nlohmann::ordered_map, std::vector, std::string, bool, int64_t, uint64_t, float>;

/// Parses `text`. `name`: for sentences, the file's. Json: nlohmann::json, nlohmann::ordered_json, FloatJson.
/// Errors: not JSON (with its byte); beyond the limits; a number that Json cannot hold (its key is named).
/// Throws nothing, and does not call itself.
template <class Json>
Result<Json> ParseJson(std::string_view text, const std::string& name, const JsonLimits& limits = {});

/// The same of a regular file. Errors also: cannot be read.
template <class Json>
Result<Json> ReadJsonFile(const std::string& path, const JsonLimits& limits = {});

/// A value in a JSON file, with its place there for sentences: "FILE: frames[3].eye: WHAT". Both the value
/// and the file's name outlive it.
class JsonValue {
 public:
  JsonValue(const nlohmann::json& value, const std::string& file, std::string key = "")
      : value_(&value), file_(&file), key_(std::move(key)) {}

  /// Errors: this is no object, or has no such member.
  Result<JsonValue> Member(const char* name) const;
  /// Nothing: it has none. Errors: this is no object.
  Result<std::optional<JsonValue>> Optional(const char* name) const;
  /// Errors: no list.
  Result<std::vector<JsonValue>> List() const;
  Result<double> Number() const;
  /// As many numbers as `out` has, each from `least` to `most`.
  Status Numbers(std::span<double> out, double least, double most) const;
  Result<std::string> Text() const;

  /// The error for what is wrong with this value.
  tl::unexpected<Error> Wrong(const std::string& what) const;

 private:
  const nlohmann::json* value_;
  const std::string* file_;
  std::string key_;
};

}  // namespace quarry
