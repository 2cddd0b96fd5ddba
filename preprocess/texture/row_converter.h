#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/voxel/texture_shape.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/texture/image_protocol.h"

namespace quarry {

/// Converts an image's decoded rows to a texture's rows: the wanted channels, as stored. 8-bit images stay as
/// they are, sRGB-encoded or not by their use. Deeper images become half floats of linear light; whole
/// numbers of colour are decoded from sRGB first, floats never. Thread safety: none.
class RowConverter {
 public:
  RowConverter(const ImageFacts& facts, bool color, TexturePick pick);

  const TexelLayout& layout() const { return layout_; }
  size_t row_bytes() const { return facts_.row_bytes(); }
  /// The stored texels of a row, valid until the next call and as long as `row`. Requires: row.size() is
  /// facts.row_bytes().
  std::span<const std::byte> Convert(std::span<const std::byte> row);

 private:
  template <class Sample>
  void Pick(std::span<const std::byte> row, std::vector<Sample>& out) const;

  ImageFacts facts_;
  TexturePick pick_;
  bool decode_ = false;  ///< deep colours that are sRGB-encoded
  TexelLayout layout_;
  Bytes texels_;
  std::vector<float> reals_;
  std::vector<uint8_t> bytes_;
};

/// Whether the texels of an image with `layout` hold opacity, picked by `pick`: an image asked for its alpha
/// may have none.
inline bool HasOpacity(const TexelLayout& layout, TexturePick pick) {
  return pick != TexturePick::kColorAndAlpha || layout.has_alpha();
}

}  // namespace quarry
