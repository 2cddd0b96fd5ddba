#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/remote/http_options.h"

namespace quarry {

/// `quarry info --parts`: prints the parts of a store, a line each, children below their parents, then the
/// materials. `find`: only the parts that it finds (PartTree::Find()), without materials; empty: all.
/// `json`: as JSON, by ascending number. `http`: of a store on a server.
/// Errors: as OpenStore() and PartTree::Read().
Status PrintParts(const std::string& scene, const std::string& find, bool json, const HttpOptions& http);

}  // namespace quarry
