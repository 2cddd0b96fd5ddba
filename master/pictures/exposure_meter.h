#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/scene/material.h"
#include "common/scene/tile.h"
#include "common/scene/view.h"

namespace quarry {

/// Linear value of the logarithmic mean of exposed surfaces: a light grey, since a picture of a model should
/// show its shape rather than a mood.
inline constexpr double kMeteredGrey = 0.3;

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

/// The picture of a view that a meter renders, on a lattice of the whole image: sample 0, or where light
/// bounces samples 0 to 15, with depth and material of sample 0. Requires: `view` is normalized.
View MeteredView(View view);
Tile MeteredTile(const View& view);
/// Appends the points that are covered of a part of MeteredTile(), from its pixels of PixelForm::kMeans.
/// `materials`: the scene's. A material emits that has an emission without a texture and is not unlit.
void AddMeteredPoints(std::span<const std::byte> pixels, std::span<const Material> materials,
                      std::vector<MeteredPoint>& points);

}  // namespace quarry
