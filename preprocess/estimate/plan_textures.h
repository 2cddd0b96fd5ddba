#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "preprocess/ingest/image_list.h"
#include "preprocess/preprocess.h"

namespace quarry {

/// What a scene's images will take.
struct PlannedTextures {
  uint64_t stored_bytes = 0;  ///< of pages
  double seconds = 0;
};

/// By the sizes that the images' headers say, and what pages take of a sample of at most 24 images, a
/// quarter of whose pages are made; images that cannot be read take nothing. Errors: the program
/// that reads them is not there, or was ended.
Result<PlannedTextures> PlanTextures(const PreprocessOptions& options, ImageList& list);

}  // namespace quarry
