#pragma once

#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// The range of a view (View::range) with which the brightest disc, rectangle, triangle or texel of the
/// environment is summed as a value in (2^13, 2^14]: a sample's terms are then far from the sums' limit,
/// 2^20, and from their resolution, 2^-32. Without these the brightest of the other lights and the background
/// counts. By lights and materials alone, never by pixels. 0 in modes whose light does not bounce, and where
/// nothing shines. `environment`: of the view's. Requires: the view is normalized. Thread-safe.
int RangeOf(const View& view, const Catalog& scene, const SkyTable* environment = nullptr);

/// Sets what the light of a view needs the scene for: the table of its atmosphere, and its range. The same
/// requirements. Thread-safe.
void FitLight(View& view, const Catalog& scene, const SkyTable* environment = nullptr);

}  // namespace quarry
