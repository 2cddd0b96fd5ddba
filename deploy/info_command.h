#pragma once

#include <string>

#include "common/base/status.h"

namespace quarry {

/// `quarry info`: what a store holds, for people or as JSON, on standard output.
Status PrintInfo(const std::string& scene, bool json);

/// `quarry verify`: reads every byte and decodes every block.
Status Verify(const std::string& scene, bool quiet);

}  // namespace quarry
