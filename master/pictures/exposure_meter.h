#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "common/base/status.h"
#include "common/engine/scene.h"
#include "common/scene/material.h"
#include "common/scene/tile.h"
#include "common/scene/view.h"

namespace quarry {

/// A point of a picture as an exposure meter sees it.
struct MeteredPoint {
  float luminance = 0;   ///< of its radiance, by the weights of sRGB's primaries
  float largest = 0;     ///< component of its radiance
  bool surface = false;  ///< it shows a surface, not a background of light
  bool emits = false;    ///< a surface that shines by itself
};

/// The exposure that shows the points well: the logarithmic mean of surfaces becomes a mean grey, but no more
/// than one point of 128 is clipped, or with film's curve more than 8 times white. Surfaces that emit light
/// do not count beside others: a window that shines may be clipped, and the room that it lights is seen.
/// Units: EV, a multiple of 1/64 in [-16, 16], which the view's range, `range`, moves; 0 without a lit
/// surface. The same for the same points in any order. Thread-safe. Source: Reinhard et al. 2002, section 3.1
/// (the key).
double ExposureFor(std::span<const MeteredPoint> points, int range = 0, ToneCurve tone = ToneCurve::kClip);

/// The picture of a view that a meter renders: sample 0 with depth and material of the whole image, on a
/// lattice. Requires: `view` is normalized.
View MeteredView(View view);
Tile MeteredTile(const View& view);
/// Appends the points that are covered of a part of MeteredTile(), from its pixels of PixelForm::kMeans.
/// `materials`: the scene's. A material emits that has an emission without a texture and is not unlit.
void AddMeteredPoints(std::span<const std::byte> pixels, std::span<const Material> materials,
                      std::vector<MeteredPoint>& points);

/// The exposure of a view, by sample 0 on a lattice of the whole image, whatever the view's crop and samples.
/// The renderer that it needs has one thread and lives for the call only. Units: `cache_bytes` of decoded
/// blocks, raised to the largest block. Returns 0 for modes that are not metered. Errors: as
/// Renderer::Render's. Thread-safe.
Result<double> MeterExposure(const Scene& scene, View view, uint64_t cache_bytes, std::stop_token stop);

}  // namespace quarry
