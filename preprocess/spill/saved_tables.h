#pragma once

#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/scene/material.h"
#include "common/scene/scene_views.h"

// What the import knows beside triangles, as notes have it: never stored, read by the version that wrote it.

namespace quarry {

void PutMaterials(const std::vector<Material>& materials, ByteWriter& out);
/// Cameras and lights.
void PutViews(const SceneViews& views, ByteWriter& out);
SceneViews GetViews(ByteReader& in);
void PutTexts(const std::vector<std::string>& texts, ByteWriter& out);

/// Bytes that end too early make `in` not ok().
std::vector<Material> GetMaterials(ByteReader& in);
std::vector<std::string> GetTexts(ByteReader& in);

}  // namespace quarry
