#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <utility>

#include "preprocess/preprocess.h"
#include "tests/support/temporary_folder.h"

// Models and stores that tests make by the programs' own means.

namespace quarry::test {

/// Runs the quarry-scene beside the tests; the model's path.
inline std::string GenerateScene(const TemporaryFolder& folder, const std::string& kind, uint64_t triangles,
                                 const std::string& extension = ".ply") {
  const std::string path = folder.file(kind + extension);
  const std::string command = std::string(QUARRY_BIN_DIR) + "/quarry-scene " + kind + " --triangles " +
                              std::to_string(triangles) + " --quiet -o " + path;
  REQUIRE(std::system(command.c_str()) == 0);
  return path;
}

/// Preprocesses, quietly; the test ends where that fails.
inline PreprocessStatistics MakeStore(PreprocessOptions options) {
  options.quiet = true;
  auto made = Preprocess(options);
  INFO((made ? "" : made.error().message));
  REQUIRE(made.has_value());
  return std::move(*made);
}

}  // namespace quarry::test
