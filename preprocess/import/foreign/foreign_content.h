#pragma once

#include <string>
#include <string_view>

#include "preprocess/import/cad/cad_protocol.h"

namespace quarry {

/// The kind of a file that is no model of Quarry's.
struct ForeignContent {
  std::string what;                  ///< "a zip archive"; empty: not recognised
  std::string advice;                ///< a step that the user can take
  bool may_be_read = false;          ///< whether Assimp may be able to read it
  CadFormat cad = CadFormat::kNone;  ///< which Open CASCADE reads
};

/// ForeignContent::what of an MTL file.
inline constexpr const char* kMaterialLibrary = "a material library";

/// Recognises a file by `start`, its first 1 KiB, and `extension`, with the dot.
ForeignContent RecognizeForeign(std::string_view start, std::string_view extension);

}  // namespace quarry
