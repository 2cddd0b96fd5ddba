#pragma once

#include <string>
#include <vector>

#include "common/scene/material_json.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Gives the images of a material of `NAME.materials.json`, at path `library`, to the sink and binds them.
/// Images are named relative to the folder of `model`, or are files NAME.image-... beside the library, which
/// models read by Assimp have. An image that is not there, or lies elsewhere, is left out with a warning, as
/// is an image that uses other texture coordinates than the first. Errors: the sink's.
Status AddLibraryTextures(const std::vector<MaterialLibrary::Image>& images, const std::string& library,
                          const std::string& model, ModelSink& sink, Material& material);

}  // namespace quarry
