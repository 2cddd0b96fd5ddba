#pragma once

#include <cstdint>
#include <string>

namespace quarry {

/// How to decode the compressed parts of a glTF file.
struct GltfDecoding {
  std::string draco;   ///< quarry-import-draco; empty: it is not there
  std::string folder;  ///< for decoded bytes; empty: the system's folder for temporary files
  /// Bytes, a ceiling: a decoder in this process takes half, quarry-import-draco all.
  uint64_t memory = 256ull << 20;
};

}  // namespace quarry
