#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/progress.h"
#include "common/base/status.h"
#include "common/kdtree/opacity_mask.h"
#include "common/scene/material.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/partition/mask_place.h"
#include "preprocess/spill/triangle_record.h"
#include "preprocess/texture/image_decoder.h"
#include "preprocess/texture/opacity_map.h"
#include "preprocess/texture/texel_sweep.h"

namespace quarry {

/// The opacity of a scene's triangles by its textures, before voxels are built. Decodes the images that
/// have opacity once more than the texture stage. Memory: 4 bytes a page of theirs, 256 KiB a thread
/// that asks; their texels lie in a temporary file, two bits each. Thread-safe after Read().
class CutOuts {
 public:
  /// Reads the images. One that cannot be read makes nothing transparent. `materials` bind textures by their
  /// index in `images`. `path`: of the temporary file. Errors: disk full; too little memory to decode.
  static Result<CutOuts> Read(const std::vector<Material>& materials, const std::vector<TextureImage>& images,
                              const ImageDecoding& decoding, const std::string& path, Progress& progress);

  /// Whether a material's opacity comes from a texture.
  bool IsMapped(uint32_t material) const {
    return material < uses_.size() && uses_[material].map != kNoIndex;
  }
  /// Whether any does.
  bool any() const { return !maps_.empty(); }
  /// The place of a triangle in its material's image. Requires: IsMapped() of its material.
  MaskPlace PlaceOf(const TriangleRecord& triangle) const;
  /// The mask of the triangles at a place, see opacity_mask.h. It never states more than the texels do.
  /// Without `fine` only the coarse mask is made.
  TriangleMask MaskAt(const MaskPlace& place, bool fine = true) const;
  /// Whether a triangle is transparent all over.
  bool IsTransparent(const TriangleRecord& triangle) const;
  /// Whether the temporary file could not be read: masks are wrong then.
  bool failed() const { return tiles_ && tiles_->failed(); }

 private:
  struct Use {
    uint32_t map = kNoIndex;
    TextureBinding binding;
  };
  TexelStates StatesOf(const TexelTriangle& place, uint32_t material) const;

  std::vector<Use> uses_;  ///< of each material
  std::vector<OpacityMap> maps_;
  std::optional<OpacityTiles> tiles_;
};

}  // namespace quarry
