#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "common/scene/scene_views.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// A viewpoint of NFF ("v"), in world coordinates.
struct NffView {
  glm::dvec3 from{0}, at{0}, up{0, 0, 1};
  double angle = 45;  ///< degrees, of the whole image
};

/// Views and lights of a file and the files it includes.
struct NffViews {
  std::vector<NffView> views;
  std::vector<NamedLight> lights;  ///< radiance holds the colour given; negative: none
};

/// Gives the views to the sink. NFF's lights do not fall off with distance, Quarry's do: each light gets the
/// radiance that makes it as bright as in NFF at the point the first view looks at. Lights without a colour
/// share brightness: 1 / sqrt(number of lights) each. Source: Haines 1988.
void GiveViews(NffViews views, ModelSink& sink);

}  // namespace quarry
