#pragma once

#include <vector>

#include "common/engine/blocks/voxel_cache.h"
#include "common/scene/view.h"
#include "tests/bench/rays/embree_scene.h"

namespace quarry::bench {

/// A ray tracer as one would write it around Embree: a pixel at a time, recursive, single rays, everything in
/// memory; camera, shading and sampling are the worker's own, so that pixels can be compared.
class EmbreeImage {
 public:
  /// `blocks`: hot and shading blocks of all voxels, by block id.
  EmbreeImage(const EmbreeScene& embree, const Catalog& catalog,
              const std::vector<std::unique_ptr<ResidentBlock>>& blocks)
      : embree_(embree), catalog_(catalog), blocks_(blocks) {}

  /// The image, 3 floats a pixel, by `threads` threads. Modes raycast, shadow and Whitted.
  std::vector<float> Render(const View& view, unsigned threads) const;

 private:
  const EmbreeScene& embree_;
  const Catalog& catalog_;
  const std::vector<std::unique_ptr<ResidentBlock>>& blocks_;
};

}  // namespace quarry::bench
