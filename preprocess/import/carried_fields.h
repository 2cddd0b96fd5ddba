#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "common/base/bytes.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Kinds of fields that model files name.
enum class FieldKind : uint8_t {
  kPlyElement,
  kPlyVertex,
  kPlyFace,
  kObjStatement,
  kMtlStatement,
  kGltf,
  kGltfMaterial,
  kGltfAttribute,
  kForeign,
};
inline constexpr uint32_t kFieldKinds = 9;

/// Compares the fields that a model file names with the fields that its reader carries into the store, and
/// names the difference in one warning, so that nothing is dropped silently. The table of carried fields
/// stands in the .cpp, for every format; 3MF, STL, OFF and NFF have so few that their readers warn
/// themselves. Memory: at most 64 names of 64 bytes a kind. Thread safety: none.
class CarriedFields {
 public:
  /// Notes that the file names `field`.
  void Names(FieldKind kind, std::string_view field);
  /// The warning of `path`. Empty: all is carried.
  std::string Sentence(const std::string& path) const;
  void Warn(const std::string& path, ModelSink& sink) const {
    if (std::string sentence = Sentence(path); !sentence.empty()) sink.Warn(std::move(sentence));
  }

 private:
  std::map<FieldKind, std::set<std::string>> left_out_;
};

}  // namespace quarry
