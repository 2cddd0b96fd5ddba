#pragma once

#include <cstdint>

namespace quarry {

/// The release, as `--version` prints it.
inline constexpr const char* kVersion = "0.1.0";

}  // namespace quarry
