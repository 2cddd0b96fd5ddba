#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "preprocess/ingest/image_list.h"
#include "preprocess/preprocess_options.h"

namespace quarry {

/// An estimate of a scene's textures.
struct PlannedTextures {
  uint64_t stored_bytes = 0;  ///< of texture pages
  double seconds = 0;
};

/// Estimates textures from the sizes in images' headers and from the stored pages of a sample: at most 24
/// images, a quarter of their pages. Images that cannot be read count nothing. Errors: the program that
/// decodes images is not there, or was killed.
Result<PlannedTextures> PlanTextures(const PreprocessOptions& options, ImageList& list);

}  // namespace quarry
