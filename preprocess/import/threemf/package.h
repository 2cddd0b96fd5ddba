#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "common/base/status.h"
#include "preprocess/import/threemf/zip_archive.h"

namespace quarry {

/// The part that `target` names, as relationships and the production extension spell it: absolute or relative
/// to the archive's root, percent-encoded or not, with slashes or backslashes. Nothing: there is none.
std::optional<uint64_t> FindPart(const ZipArchive& archive, std::string_view target);

/// The part that holds the model, which the archive's relationships (_rels/.rels) name; without them
/// 3D/3dmodel.model. Errors: there is none, or it is encrypted (the secure content extension).
Result<uint64_t> FindModelPart(ZipArchive& archive);

}  // namespace quarry
