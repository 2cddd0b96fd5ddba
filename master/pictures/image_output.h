#pragma once

#include <cstdint>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/scene/render_job.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Facts of the scene that an image file states.
struct SceneFacts {
  SceneId id{};
  glm::dvec3 offset{0};  ///< SceneMeta::offset
};

/// The frame as the bytes of a file: PNG (8 bits, sRGB after exposure and tone curve, opaque: kBackdrop lies
/// behind it, or with View::transparent an alpha channel) or EXR (float colour R, G, B, multiplied by the
/// coverage A, without the backdrop; then the layers asked for: depth.Z, also as Z, normal.X/Y/Z, also as
/// N.X/Y/Z, uv.U/V as float, primitive/material/part/voxel.id as unsigned integers). `ev`: exposure of a PNG.
/// `pixels`: rows of the crop, WordsPerPixel(view.aov_mask) words each. The file states the program's
/// version, the scene's id, the camera in the model's coordinates and the samples a pixel. The same bytes for
/// the same pixels and facts: nothing in it is of a host, a time or a number of threads.
Result<Bytes> EncodeImage(const View& view, const ImageFormat& format, const SceneFacts& scene, double ev,
                          const std::vector<uint32_t>& pixels);
/// Upper bound on the bytes of an encoded image, one that does not compress.
uint64_t EncodedBytes(const View& view, const ImageFormat& format);

}  // namespace quarry
