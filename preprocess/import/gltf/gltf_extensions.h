#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_document.h"

namespace quarry {

/// Checks the document's extensions. Returns a warning for each used extension that Quarry does not read.
/// Errors: an unread extension is required, or changes the triangles.
Result<std::vector<std::string>> CheckGltfExtensions(const GltfDocument& document);

/// Whether the document's list of required extensions holds `name`.
bool RequiresExtension(const GltfDocument& document, const std::string& name);

/// Errors: `object` (a primitive or a buffer view, called `where`) names an extension that compresses it, and
/// there is no uncompressed copy (`has_copy`).
Status CheckNotCompressed(const GltfDocument& document, const nlohmann::json& object,
                          const std::string& where, bool has_copy);

}  // namespace quarry
