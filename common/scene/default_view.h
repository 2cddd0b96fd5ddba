#pragma once

#include "common/scene/scene_summary.h"
#include "common/scene/view.h"

namespace quarry {

/// Lights of a view that names none: the scene's own, else DefaultSun() and, in an interior where nothing
/// shines, a lamp at the eye. DropDefaultLamp() takes the lamp away where it is not wanted. Thread-safe.
std::vector<Light> DefaultLights(const SceneSummary& scene);

/// The sky of a view that names neither lights nor a sky: a clear one where DefaultSun() is the only light.
/// Thread-safe.
Sky DefaultSky(const SceneSummary& scene);

/// Takes the default lamp at the eye from a view whose mode is not path. For views whose lights are the
/// default ones. Thread-safe.
void DropDefaultLamp(View& view);

/// Turns DefaultSun() to the up axis that the view names; other lights stay. For views whose lights are the
/// default ones. Thread-safe.
void TurnDefaultSun(View& view);

/// Takes DefaultSun() from a view of mode path if the scene shines by itself, so that it needs no sun: then
/// its default view has no sky. For views whose lights are the default ones, after TurnDefaultSun().
/// Thread-safe.
void DropDefaultSun(View& view);

/// Length of occlusion rays of a view from inside: a share of the distance of things, so that pipes near the
/// eye do not all lie in each other's shade. Units: scene units. Requires: `scene.framing.inside` is set.
/// Thread-safe.
float InsideAoDistance(const SceneSummary& scene);

/// The picture that `quarry render` makes of a scene without options but `width` and `height`: not
/// normalized. Thread-safe.
View DefaultView(const SceneSummary& scene, uint32_t width, uint32_t height);

}  // namespace quarry
