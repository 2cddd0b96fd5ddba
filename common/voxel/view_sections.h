#pragma once

#include <span>
#include <string>
#include <string_view>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/scene/scene_views.h"

namespace quarry {

/// The CAMS and the LITE section; names are appended to `strings` and referred to.
Bytes EncodeCameras(const std::vector<NamedCamera>& cameras, std::string& strings);
Bytes EncodeLights(const std::vector<NamedLight>& lights, std::string& strings);

/// Errors: a size that cannot be, more than there may be, numbers that no camera or light has.
Result<std::vector<NamedCamera>> DecodeCameras(std::span<const std::byte> bytes, std::string_view strings);
Result<std::vector<NamedLight>> DecodeLights(std::span<const std::byte> bytes, std::string_view strings);

}  // namespace quarry
