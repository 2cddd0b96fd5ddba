#pragma once

#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/scene/scene_views.h"
#include "common/voxel/store_names.h"

namespace quarry {

/// Encode the sections CAMS and LITE; append the names to `strings`.
Bytes EncodeCameras(const std::vector<NamedCamera>& cameras, std::string& strings);
Bytes EncodeLights(const std::vector<NamedLight>& lights, std::string& strings);

/// Decode the sections CAMS and LITE. Errors: a wrong size; too many entries; values that no camera or light
/// may have; the errors of `name_at`.
Result<std::vector<NamedCamera>> DecodeCameras(std::span<const std::byte> bytes, const NameLookup& name_at);
Result<std::vector<NamedLight>> DecodeLights(std::span<const std::byte> bytes, const NameLookup& name_at);

}  // namespace quarry
