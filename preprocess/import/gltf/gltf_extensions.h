#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_document.h"

namespace quarry {

/// Looks at the extensions that a document names. Returns a warning for each that it uses and that is not
/// read. Errors: one that it requires, or that changes what triangles there are, is not read.
Result<std::vector<std::string>> CheckGltfExtensions(const GltfDocument& document);

/// That nothing compressed is taken for what it stands for: `object` (a primitive or a buffer view, called
/// `where`) names no extension that compresses it. `has_copy`: what is not compressed lies beside it.
Status CheckNotCompressed(const GltfDocument& document, const nlohmann::json& object,
                          const std::string& where, bool has_copy);

}  // namespace quarry
