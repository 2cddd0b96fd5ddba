#pragma once

#include <cstdint>

namespace quarry {

/// The release, as `--version` prints it.
inline constexpr const char* kVersion = "0.1.0";

/// Raised when the preprocessor makes another store of the same model than before: stores that are kept for
/// models (`quarry render MODEL`), and unfinished ones, are made anew.
inline constexpr int kImportVersion = 3;

}  // namespace quarry
