#pragma once

#include <string>

#include "common/base/status.h"

namespace quarry {

/// The store to render: `scene` itself when it is one, else the store of that model in the user's cache
/// folder
/// ($QUARRY_CACHE_DIR, else $XDG_CACHE_HOME/quarry, else ~/.cache/quarry), made first unless it is there and
/// the model's size and time of change are those it was made from.
Result<std::string> StoreFor(const std::string& scene, bool quiet);

}  // namespace quarry
