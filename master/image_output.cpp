#include "master/image_output.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <bit>
#include <cmath>

#include "common/math/elementary.h"

namespace quarry {
namespace {

std::vector<uint8_t> ToSrgb(const RenderJob& job, const std::vector<uint32_t>& pixels) {
  const size_t words = WordsPerPixel(job.aov_mask);
  const double gain = Exp2(job.exposure);
  std::vector<uint8_t> out;
  out.reserve(pixels.size() / words * 3);
  for (size_t p = 0; p < pixels.size(); p += words)
    for (size_t c = 0; c < 3; ++c) {
      const double encoded = EncodeSrgb(static_cast<double>(std::bit_cast<float>(pixels[p + c])) * gain);
      out.push_back(static_cast<uint8_t>(encoded * 255 + 0.5));
    }
  return out;
}

void AddChannels(const RenderJob& job, OIIO::ImageSpec& spec) {
  static const std::vector<std::string> names[kAovs] = {
      {"depth.Z"},      {"normal.X", "normal.Y", "normal.Z"},
      {"uv.U", "uv.V"}, {"primitive.id"},
      {"material.id"},  {"part.id"},
      {"voxel.id"}};
  spec.channelnames = {"R", "G", "B"};
  spec.channelformats.assign(3, OIIO::TypeFloat);
  for (int a = 0; a < kAovs; ++a) {
    if (!job.has(static_cast<Aov>(a))) continue;
    for (const std::string& name : names[a]) {
      spec.channelnames.push_back(name);
      spec.channelformats.push_back(kAovInfo[a].is_integer ? OIIO::TypeUInt32 : OIIO::TypeFloat);
    }
  }
  spec.nchannels = static_cast<int>(spec.channelnames.size());
}

}  // namespace

Result<Bytes> EncodeImage(const RenderJob& job, const std::vector<uint32_t>& pixels) {
  const bool png = job.format == "png";
  std::vector<unsigned char> file;
  OIIO::Filesystem::IOVecOutput memory(file);
  auto output = OIIO::ImageOutput::create(png ? "out.png" : "out.exr");
  if (!output) return Fail("OpenImageIO cannot write " + job.format + ": " + OIIO::geterror());
  OIIO::ImageSpec spec(static_cast<int>(job.crop_width), static_cast<int>(job.crop_height), 3,
                       png ? OIIO::TypeUInt8 : OIIO::TypeFloat);
  spec.full_width = static_cast<int>(job.width);
  spec.full_height = static_cast<int>(job.height);
  // OpenImageIO would put in the time of day; the same picture is to be the same file.
  spec.attribute("DateTime", "2000:01:01 00:00:00");
  if (!png) {
    spec.x = static_cast<int>(job.crop_x);
    spec.y = static_cast<int>(job.crop_y);
    spec.attribute("compression", "zip");
    AddChannels(job, spec);
  } else {
    spec.full_width = spec.width;
    spec.full_height = spec.height;
    spec.attribute("oiio:ColorSpace", "sRGB");
  }
  if (!output->set_ioproxy(&memory) || !output->open(png ? "out.png" : "out.exr", spec))
    return Fail("cannot encode the image: " + output->geterror());
  const auto srgb = png ? ToSrgb(job, pixels) : std::vector<uint8_t>{};
  const bool written = png ? output->write_image(OIIO::TypeUInt8, srgb.data())
                           : output->write_image(OIIO::TypeUnknown, pixels.data());
  if (!written || !output->close()) return Fail("cannot encode the image: " + output->geterror());
  const auto* bytes = reinterpret_cast<const std::byte*>(file.data());
  return Bytes(bytes, bytes + file.size());
}

}  // namespace quarry
