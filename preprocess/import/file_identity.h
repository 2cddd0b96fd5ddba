#pragma once

#include <string>

namespace quarry {

/// A file as it must be found again by a run that goes on after it: its path, size and time.
std::string FileIdentity(const std::string& path);

}  // namespace quarry
