#pragma once

#include <string>

#include "common/base/status.h"

namespace quarry {

/// `quarry info`: prints the contents of a store on standard output, as text or JSON. Errors: as
/// StoreReader::Open().
Status PrintInfo(const std::string& scene, bool json);

/// Prints the names that the ids of parts and materials stand for, a line each. Errors: as
/// StoreReader::Open().
Status PrintParts(const std::string& scene);

/// Prints a store's textures, each with its shape, its bytes and the materials that use it, as text or JSON.
/// Errors: as StoreReader::Open().
Status PrintTextures(const std::string& scene, bool json);

/// `quarry verify`: reads every byte of a store and decodes every block and page. Errors: the first problem
/// found.
Status Verify(const std::string& scene, bool quiet);

}  // namespace quarry
