#include "preprocess/estimate/plan_textures.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <system_error>
#include <vector>

#include "common/voxel/store_writer.h"
#include "preprocess/texture/mip_builder.h"
#include "preprocess/texture/row_converter.h"

namespace quarry {
namespace {

constexpr double kStartSeconds = 0.4;        // to start the decoder process
constexpr double kMoreLevels = 4.0 / 3;      // texels of all levels over the image's
constexpr double kTexelSeconds = 1.5e-8;     // for a byte of all levels, by tests/bench/stores/plans
constexpr size_t kSamples = 24;              // images that are decoded
constexpr uint64_t kSampleBytes = 16 << 20;  // of texels decoded of each image
constexpr uint32_t kEncodedPages = 4;        // encodes each n-th page

struct Sized {
  const TextureImage* image;
  double bytes;          ///< of the image's texels, level 0
  double file_part = 0;  ///< bytes of the image's file over `bytes`
};

double FileBytes(const TextureImage& image) {
  if (image.size != TextureImage::kToTheEnd) return static_cast<double>(image.size);
  std::error_code none;
  const uintmax_t bytes = std::filesystem::file_size(image.file, none);
  return none ? 0 : static_cast<double>(bytes);
}

/// Stored bytes of pages over bytes of their texels. Nothing: the image cannot be decoded. Errors: see
/// ImageDecoder::is_fatal().
Result<std::optional<double>> MeasureRatio(ImageDecoder& decoder, const TextureImage& image) {
  std::optional<RowConverter> converter;
  std::optional<MipBuilder> mips;
  uint64_t rows = 0, stored = 0, texels = 0;
  const auto on_facts = [&](const ImageFacts& facts) -> Status {
    converter.emplace(facts, image.color, image.pick);
    const TexelLayout& layout = converter->layout();
    mips.emplace(layout, [&, layout](uint32_t page, std::span<const std::byte> bytes) -> Status {
      if (page % kEncodedPages != 0) return {};
      const TextureShape shape(layout.width, layout.height);
      stored += EncodeTexturePage(shape, layout, page, bytes).stored.size();
      texels += bytes.size();
      return {};
    });
    return {};
  };
  bool enough = false;
  const auto on_row = [&](std::span<const std::byte> row) -> Status {
    const std::span<const std::byte> converted = converter->Convert(row);
    rows += converted.size();
    enough = rows > kSampleBytes;
    if (enough) return Fail("enough");
    return mips->AddRow(converted);
  };
  const Status decoded = decoder.Decode(image, on_facts, on_row);
  if (!decoded && !enough && decoder.is_fatal()) return tl::unexpected<Error>(decoded.error());
  if ((!decoded && !enough) || texels == 0) return std::nullopt;
  return static_cast<double>(stored) / static_cast<double>(texels);
}

/// The images to decode, of images that have `bytes` of texels together, and the share of bytes that each
/// stands for. Up to kSamples images: all. Of more: ordered by how much their files compress, an image is
/// taken at equal steps of bytes, so large images are likelier and every kind is met.
std::vector<Sized> Sample(std::vector<Sized> images, double bytes) {
  if (images.size() <= kSamples) return images;
  std::stable_sort(images.begin(), images.end(),
                   [](const Sized& a, const Sized& b) { return a.file_part < b.file_part; });
  const double each = bytes / kSamples;
  std::vector<Sized> sample;
  double passed = 0, next = each / 2;
  for (const Sized& i : images) {
    passed += i.bytes;
    double stands_for = 0;
    for (; next < passed; next += each) stands_for += each;
    if (stands_for > 0) sample.push_back({i.image, stands_for});
  }
  return sample;
}

}  // namespace

Result<PlannedTextures> PlanTextures(const PreprocessOptions& options, ImageList& list) {
  QUARRY_ASSIGN(const std::vector<TextureImage> images, list.Finish());
  ImageDecoder decoder(ImageDecodingOf(options));
  std::vector<Sized> sized;
  double bytes = 0;
  for (const TextureImage& image : images) {
    const Result<ImageFacts> facts = decoder.LookAt(image);
    if (!facts && decoder.is_fatal()) return tl::unexpected<Error>(facts.error());
    if (!facts) continue;
    const TexelLayout layout = RowConverter(*facts, image.color, image.pick).layout();
    const double texels = static_cast<double>(layout.width) * layout.height * layout.texel_bytes();
    sized.push_back({&image, texels, FileBytes(image) / texels});
    bytes += texels;
  }
  double stored = 0, measured = 0;
  for (const Sized& sample : Sample(sized, bytes)) {
    QUARRY_ASSIGN(const std::optional<double> ratio, MeasureRatio(decoder, *sample.image));
    if (!ratio) continue;
    stored += *ratio * sample.bytes;
    measured += sample.bytes;
  }
  bytes *= kMoreLevels;
  return PlannedTextures{static_cast<uint64_t>(measured > 0 ? bytes * stored / measured : 0),
                         images.empty() ? 0 : kStartSeconds + bytes * kTexelSeconds};
}

}  // namespace quarry
