#pragma once

#include <string>

#include "common/base/status.h"
#include "common/remote/http_options.h"

namespace quarry {

/// `quarry info`: prints the contents of a store on standard output, as text or JSON. `http`: of a store
/// on a server. Errors: as OpenStore().
Status PrintInfo(const std::string& scene, bool json, const HttpOptions& http);

/// Prints a store's textures, each with its shape, its bytes and the materials that use it, as text or JSON.
/// Errors: as OpenStore().
Status PrintTextures(const std::string& scene, bool json, const HttpOptions& http);

/// `quarry verify`: reads every byte of a store and decodes every block and page. Errors: the first problem
/// found.
Status Verify(const std::string& scene, bool quiet, const HttpOptions& http);

}  // namespace quarry
