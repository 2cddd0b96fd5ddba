#pragma once

#include <string>
#include <string_view>

namespace quarry {

/// A file that is no model that Quarry reads, told by its first bytes.
struct ForeignContent {
  std::string what;          ///< "a zip archive"; empty: it is none of those known
  std::string advice;        ///< what to do next
  bool may_be_read = false;  ///< by Assimp, some of them
};

/// What `what` says of an MTL file.
inline constexpr const char* kMaterialLibrary = "a material library";

/// `start`: the first bytes of the file, 1 KiB or all. `extension`: of its name, with the dot.
ForeignContent RecognizeForeign(std::string_view start, std::string_view extension);

}  // namespace quarry
