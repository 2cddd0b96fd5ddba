#include "common/engine/surfaces/texture_filter.h"

#include "common/math/elementary.h"

namespace quarry {

const TexelCodes& TexelCodes::Get() {
  static const TexelCodes codes;
  return codes;
}

TexelCodes::TexelCodes() {
  for (int i = 0; i < 256; ++i) {
    srgb[i] = static_cast<float>(DecodeSrgb(i / 255.0));
    linear[i] = static_cast<float>(i) / 255.0f;
  }
}

TexturePyramid::TexturePyramid(const Catalog& catalog, uint32_t texture)
    : layout(catalog.textures[texture].layout) {
  const TextureShape& shape = catalog.shapes[texture];
  for (uint32_t l = 0; l < shape.levels().size(); ++l) {
    const TextureShape::Level& level = shape.levels()[l];
    const bool tail = l >= shape.tail();
    levels.push_back({level.width, level.height, tail ? 0 : level.columns,
                      catalog.PageKey(texture, level.first_page).index(), tail ? shape.TailOffset(l) : 0});
  }
}

}  // namespace quarry
