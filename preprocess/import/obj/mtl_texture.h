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
  TextureBinding binding;  ///< without its texture; `factor` is what the options multiply the texel by
  std::string file;        ///< as written
  bool color = true;
  TexturePick pick = TexturePick::kColor;
  uint64_t line = 0;
  std::string left_out;  ///< options that a binding cannot say, for a warning; empty: all is said
};

/// map_Kd, map_Ks, map_Ke, map_d, map_bump or bump, norm or map_Kn, whatever the case. Nothing for other
/// words.
std::optional<MtlTexture> MtlTextureFor(std::string_view keyword);

/// What follows the keyword: options, then the file's name, which may hold blanks. Read are -s and -o (scale
/// and offset of the coordinates), -clamp, -bm, -imfchan, and of -mm the gain; passed over as without meaning
/// here -blendu, -blendv, -boost, -cc, -texres and -type; said to be left out -t and the base of -mm. OBJ's v
/// runs up the image, which the binding's transform turns around. False if there is no name, or an option's
/// value is none.
bool ParseMtlTexture(TextCursor& rest, MtlTexture& texture);

}  // namespace quarry
