#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "common/scene/scene_views.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// A viewpoint of NFF, "v", where transforms put it.
struct NffView {
  glm::dvec3 from{0}, at{0}, up{0, 0, 1};
  double angle = 45;  ///< degrees, of the whole image
};

/// What a file and those that it includes say of how they are to be seen.
struct NffViews {
  std::vector<NffView> views;
  std::vector<NamedLight> lights;  ///< their radiance is the colour given; less than 0: none
};

/// Gives them to the sink. NFF's lights do not fall off with distance, and Quarry's do: each gets what it
/// needs to be as bright as NFF has it at the point that the first view looks at. Lights without a colour
/// share brightness: one over the root of their number (Haines 1988).
void GiveViews(NffViews views, ModelSink& sink);

}  // namespace quarry
