#pragma once

#include <cstdint>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/scene/render_job.h"

namespace quarry {

/// The frame as the bytes of a file: PNG (8 bits, sRGB after exposure, opaque) or EXR (float colour R, G, B,
/// then the layers asked for: depth.Z, normal.X/Y/Z, uv.U/V as float, primitive/material/part/voxel.id as
/// unsigned integers). `pixels`: rows of the crop, WordsPerPixel(view.aov_mask) words each. The same bytes
/// for the same pixels.
Result<Bytes> EncodeImage(const View& view, const ImageFormat& format, const std::vector<uint32_t>& pixels);

}  // namespace quarry
