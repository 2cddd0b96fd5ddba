#pragma once

#include <algorithm>
#include <catch2/catch.hpp>
#include <span>
#include <utility>
#include <vector>

#include "common/engine/renderer.h"
#include "master/pictures/exposure_meter.h"

namespace quarry::test {

/// The exposure of a view, metered by one renderer in this process. Units: `cache_bytes` of decoded blocks,
/// raised to the largest block. 0 for modes that are not metered.
inline double Metered(const Scene& scene, View view, uint64_t cache_bytes = 1 << 20) {
  if (!InfoOf(view.mode).metered) return 0;
  view = MeteredView(std::move(view));
  const Tile tile = MeteredTile(view);
  const auto renderer =
      Renderer::Create(scene, {std::max<uint64_t>(cache_bytes, scene.catalog().meta.largest_decoded), 1});
  REQUIRE(renderer.has_value());
  Bytes pixels;
  const auto take = [&](size_t, RenderedTile result, Renderer::Progress) {
    pixels = std::move(result.pixels);
  };
  REQUIRE((*renderer)->Render(view, std::span(&tile, 1), take).has_value());
  std::vector<MeteredPoint> points;
  AddMeteredPoints(pixels, scene.catalog().materials, points);
  return ExposureFor(points, view.range, InfoOf(view.mode).tone);
}

}  // namespace quarry::test
