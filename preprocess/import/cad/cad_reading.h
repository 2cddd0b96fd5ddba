#pragma once

#include <cstdint>
#include <string>

namespace quarry {

/// How to make triangles of exact surfaces.
struct CadReading {
  std::string program;  ///< quarry-import-cad; empty: such models are refused
  std::string folder;   ///< for models that come packed or by a pipe; empty: the system's for temporary files
  uint64_t memory = 1ull << 30;  ///< bytes that the program may take beyond its own
  double linear = 0;             ///< most distance of triangles from surfaces, of the file's unit; 0: by size
  double angle = 0;              ///< degrees between neighbouring triangles; 0: the default
};

/// Memory that Open CASCADE takes, over a file's bytes (tests/bench/history/preprocess.md). Larger files are
/// refused before they are read.
inline constexpr uint64_t kCadBytesPerByte = 24;

}  // namespace quarry
