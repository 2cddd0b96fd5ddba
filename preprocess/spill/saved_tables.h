#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "common/base/bytes.h"
#include "common/scene/material.h"
#include "common/scene/scene_views.h"

// The scene's tables in a checkpoint: never stored, and read only by the version that wrote them.

namespace quarry {

void PutText(std::string_view text, ByteWriter& out);
std::string GetText(ByteReader& in);

void PutMaterials(const std::vector<Material>& materials, ByteWriter& out);
/// Each appends a table to `out`.
void PutViews(const SceneViews& views, ByteWriter& out);
SceneViews GetViews(ByteReader& in);
void PutTexts(const std::vector<std::string>& texts, ByteWriter& out);

/// Each reads a table. Bytes that end too early make `in` not ok().
std::vector<Material> GetMaterials(ByteReader& in);
std::vector<std::string> GetTexts(ByteReader& in);

}  // namespace quarry
