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

/// The images of a glTF document, given to the sink as materials name them: files, data: URIs, buffer views.
/// What cannot be carried (a file that is not there, a format that is not read, texture coordinates other
/// than the first) is warned of once and left out.
class GltfTextures {
 public:
  GltfTextures(GltfDocument& document, ModelSink& sink) : document_(document), sink_(sink), warn_(sink) {}

  /// Adds to `material` the texture that `info` (a textureInfo; nothing is added if it names none) gives for
  /// `binding`, whose texture, wraps and transform are filled in. Errors: the sink's.
  Status Add(const nlohmann::json& info, TextureBinding binding, bool color, TexturePick pick,
             Material& material);

 private:
  /// A texture of the document: its image and how that goes on beyond its borders.
  struct Sampled {
    uint64_t image;
    TextureWrap wrap_s, wrap_t;
  };
  Result<Sampled> Find(uint64_t texture) const;
  /// Fills in all of `binding` but its texture; returns the image. Errors: why the material does without it.
  Result<uint64_t> Complete(const nlohmann::json& info, TextureBinding& binding) const;
  Result<TextureImage> Locate(uint64_t index);
  template <class Read>
  std::invoke_result_t<Read> Guarded(Read&& read) const;

  GltfDocument& document_;
  ModelSink& sink_;
  WarnOnce warn_;
  std::map<std::tuple<uint64_t, bool, TexturePick>, uint32_t> given_;  ///< by image and use
};

}  // namespace quarry
