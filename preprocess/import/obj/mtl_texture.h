#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "common/scene/material.h"
#include "preprocess/import/text/text_number.h"
#include "preprocess/import/texture_image.h"

namespace quarry {

/// A statement of MTL that names an image.
struct MtlTexture {
  TextureBinding binding;  ///< without its texture; `factor` is the options' factor on the texel
  std::string file;        ///< as written
  bool color = true;
  TexturePick pick = TexturePick::kColor;
  uint64_t line = 0;
  std::string left_out;  ///< options that a binding cannot express, for a warning
};

/// The texture for map_Kd, map_Ks, map_Ke, map_d, map_bump or bump, norm or map_Kn, in any case. Nothing for
/// other words.
std::optional<MtlTexture> MtlTextureFor(std::string_view keyword);

/// Parses the text after the keyword: options, then a file name, which may hold blanks. Read: -s and -o
/// (scale and offset of the coordinates), -clamp, -bm, -imfchan, the gain of -mm. Ignored, without effect
/// here: -blendu, -blendv, -boost, -cc, -texres, -type. Left out with a warning: -t, the base of -mm. OBJ's v
/// runs up the image; the binding's transform turns it around. False: no name, or an option without its
/// value.
bool ParseMtlTexture(TextCursor& rest, MtlTexture& texture);

}  // namespace quarry
