#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <tuple>
#include <type_traits>

#include "preprocess/import/gltf/gltf_document.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/import/warn_once.h"

namespace quarry {

/// Gives a glTF document's images to the sink as materials name them: files, data: URIs, buffer views. An
/// image that cannot be used (no such file, an unread format, other texture coordinates than UseSet's) is
/// left out with one warning. Thread safety: none.
class GltfTextures {
 public:
  enum class Warnings { kAll, kNone };  ///< none: the same textures have been added before
  GltfTextures(GltfDocument& document, ModelSink& sink, Warnings warnings = Warnings::kAll)
      : document_(document), sink_(sink), warnings_(warnings), warn_(sink) {}

  /// The n of TEXCOORD_n that the texture of `info` (a textureInfo) uses; an impossible n becomes the largest
  /// number.
  static uint32_t UvSetOf(const nlohmann::json& info);
  /// Sets the texture coordinates that the next material's triangles carry.
  void UseSet(uint32_t uv_set) { uv_set_ = uv_set; }

  /// Adds the texture of `info` (a textureInfo) to `material`, with `binding`'s texture, wraps and transform
  /// filled in. Adds nothing if `info` names no texture. Errors: the sink's.
  Status Add(const nlohmann::json& info, TextureBinding binding, bool color, TexturePick pick,
             Material& material);

 private:
  /// A texture of the document: its image and wrap modes.
  struct Sampled {
    uint64_t image;
    TextureWrap wrap_s, wrap_t;
  };
  Result<Sampled> Find(uint64_t texture) const;
  /// Fills in `binding` except its texture; returns the image. Errors: why the material, named `material`,
  /// does without the texture.
  Result<uint64_t> Complete(const nlohmann::json& info, const std::string& material,
                            TextureBinding& binding) const;
  Result<TextureImage> Locate(uint64_t index);
  void Warn(const std::string& message) {
    if (warnings_ == Warnings::kAll) warn_(message);
  }
  template <class Read>
  std::invoke_result_t<Read> Guarded(Read&& read) const;

  GltfDocument& document_;
  ModelSink& sink_;
  Warnings warnings_;
  WarnOnce warn_;
  uint32_t uv_set_ = 0;
  std::map<std::tuple<uint64_t, bool, TexturePick>, uint32_t> given_;  ///< by image and use
};

}  // namespace quarry
