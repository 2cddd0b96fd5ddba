#include "preprocess/plan_textures.h"

#include "preprocess/texture/row_converter.h"

namespace quarry {
namespace {

// Measured: preprocess/README.md.
constexpr double kMoreLevels = 4.0 / 3;  // texels of all levels than of the image
constexpr double kStoredTexels = 0.6;    // bytes of pages than of texels
constexpr double kTexelSeconds = 4e-8;   // a byte of texels of all levels

}  // namespace

Result<PlannedTextures> PlanTextures(const PreprocessOptions& options, ImageList& list) {
  QUARRY_ASSIGN(const std::vector<TextureImage> images, list.Finish());
  ImageDecoder decoder(ImageDecodingOf(options));
  double bytes = 0;
  for (const TextureImage& image : images) {
    const Result<ImageFacts> facts = decoder.LookAt(image);
    if (!facts && decoder.is_fatal()) return tl::unexpected<Error>(facts.error());
    if (!facts) continue;
    const TexelLayout layout = RowConverter(*facts, image.color, image.pick).layout();
    bytes += static_cast<double>(layout.width) * layout.height * layout.texel_bytes();
  }
  bytes *= kMoreLevels;
  return PlannedTextures{static_cast<uint64_t>(bytes * kStoredTexels), bytes * kTexelSeconds};
}

}  // namespace quarry
