#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_document.h"

namespace quarry {

/// The place, in the document's decoded bytes, of buffer view `index`, `view`, which EXT_meshopt_compression
/// compresses; nothing if the extension does not. Each view is decoded once, whole.
/// Memory: half of GltfDecoding::memory, at most, while it decodes.
/// Errors, with the view's name: parameters that the extension does not allow; more elements than the bytes
/// can hold; more memory; a newer version of the codec; damaged bytes.
Result<std::optional<uint64_t>> DecodeMeshoptView(GltfDocument& document, uint64_t index,
                                                  const nlohmann::json& view);

}  // namespace quarry
