#include "preprocess/import/nff/nff_views.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>

namespace quarry {

void GiveViews(NffViews views, ModelSink& sink) {
  const glm::dvec3 looked_at = views.views.empty() ? glm::dvec3(0) : views.views.front().at;
  for (size_t i = 0; i < views.views.size(); ++i) {
    const NffView& view = views.views[i];
    sink.AddCamera({fmt::format("view {}", i + 1),
                    {view.from, view.at, view.up, std::clamp(view.angle, 0.01, 179.0), 0}});
  }
  const float shared = 1 / std::sqrt(static_cast<float>(std::max<size_t>(views.lights.size(), 1)));
  for (size_t i = 0; i < views.lights.size(); ++i) {
    NamedLight& light = views.lights[i];
    if (light.name.empty()) light.name = fmt::format("light {}", i + 1);
    if (light.radiance.x < 0) light.radiance = glm::vec3(shared);
    const glm::dvec3 to = light.position - looked_at;
    light.radiance *= static_cast<float>(std::max(glm::dot(to, to), 1e-12));
    sink.AddLight(std::move(light));
  }
}

}  // namespace quarry
