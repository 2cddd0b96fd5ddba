#pragma once

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_document.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Gives the sink the cameras and lights of the scene's nodes. KHR_lights_punctual: candela and lux are
/// divided by pi to get radiance, so a white surface under a sun of pi lux is as bright as its colour; ranges
/// are ignored. Errors: a camera or light is absent or unusable.
Status ReadGltfViews(const GltfDocument& document, ModelSink& sink);

}  // namespace quarry
