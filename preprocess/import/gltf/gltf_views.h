#pragma once

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_document.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Gives the sink the cameras of the scene's nodes and their lights (KHR_lights_punctual: candela and lux
/// become radiance by a division by pi, so that a white surface under a sun of pi lux is as bright as its
/// colour; ranges are left out). Errors: a camera or light that is not there or cannot be.
Status ReadGltfViews(const GltfDocument& document, ModelSink& sink);

}  // namespace quarry
