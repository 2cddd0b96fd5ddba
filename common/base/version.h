#pragma once

#include <cstdint>

namespace quarry {

/// The release that `--version` prints.
inline constexpr const char* kVersion = "0.1.0";

/// Version of the importer. Raise it when the preprocessor makes another store of the same model: stores kept
/// for models (`quarry render MODEL`) and unfinished stores are then made anew.
inline constexpr int kImportVersion = 8;

}  // namespace quarry
