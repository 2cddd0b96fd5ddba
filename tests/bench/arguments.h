#pragma once

#include <CLI/CLI.hpp>
#include <optional>

namespace quarry::bench {

/// Reads a benchmark's arguments. Returns: the status to end with, after --help (0) or unusable arguments (2,
/// and a sentence); none to go on.
inline std::optional<int> ReadArguments(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return std::nullopt;
}

}  // namespace quarry::bench
