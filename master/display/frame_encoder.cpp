#include "master/display/frame_encoder.h"

#include <fmt/format.h>
#include <turbojpeg.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "common/base/resource.h"
#include "common/math/elementary.h"
#include "common/math/shared_exponent.h"
#include "master/pictures/shown_color.h"

namespace quarry {
namespace {

using Level = RgbMaker::Level;

/// Least quality of stretched images: stretching enlarges their faults, and they are small.
constexpr int kSmallQuality = 92;

/// Makes the level of half the size: each pixel is the mean of the known pixels of a square.
void Halve(const Level& fine, Level& half) {
  half.Open((fine.width + 1) / 2, (fine.height + 1) / 2);
  for (uint32_t y = 0; y < half.height; ++y)
    for (uint32_t x = 0; x < half.width; ++x) {
      uint32_t r = 0, g = 0, b = 0, known = 0;
      for (uint32_t j = 2 * y; j < std::min(2 * y + 2, fine.height); ++j)
        for (uint32_t i = 2 * x; i < std::min(2 * x + 2, fine.width); ++i) {
          const Level::Pixel& p = fine.at(i, j);
          if (!p.known) continue;
          r += p.r;
          g += p.g;
          b += p.b;
          ++known;
        }
      if (known > 0)
        half.at(x, y) = {static_cast<uint16_t>(r / known), static_cast<uint16_t>(g / known),
                         static_cast<uint16_t>(b / known), 1};
    }
}

/// Fills the unknown pixels of a level from a complete one of half the size, bilinearly.
void FillFrom(const Level& half, Level& fine) {
  const auto other = [](uint32_t at, uint32_t length) {  // the second nearest of half's pixels
    const uint32_t near = at / 2;
    if (at % 2 == 0) return near == 0 ? near : near - 1;
    return std::min(near + 1, length - 1);
  };
  for (uint32_t y = 0; y < fine.height; ++y)
    for (uint32_t x = 0; x < fine.width; ++x) {
      Level::Pixel& to = fine.at(x, y);
      if (to.known) continue;
      const uint32_t x1 = other(x, half.width), y1 = other(y, half.height);
      const Level::Pixel &a = half.at(x / 2, y / 2), &b = half.at(x1, y / 2), &c = half.at(x / 2, y1),
                         &d = half.at(x1, y1);
      const auto mix = [](uint32_t p, uint32_t q, uint32_t r, uint32_t s) {
        return static_cast<uint16_t>((9 * p + 3 * q + 3 * r + s + 8) / 16);
      };
      to = {mix(a.r, b.r, c.r, d.r), mix(a.g, b.g, c.g, d.g), mix(a.b, b.b, c.b, d.b), 1};
    }
}

/// Fills the unknown pixels of levels[at]. Source: push-pull of Gortler et al. 1996, section 3.4, with
/// weights of 0 and 1.
void FillHoles(std::vector<Level>& levels, size_t at, const Level::Pixel& background) {
  if (levels[at].pixels.size() == 1) {
    if (!levels[at].pixels[0].known) levels[at].pixels[0] = background;
    return;
  }
  if (std::ranges::all_of(levels[at].pixels, [](const auto& p) { return p.known != 0; })) return;
  if (levels.size() == at + 1) levels.emplace_back();
  Halve(levels[at], levels[at + 1]);
  FillHoles(levels, at + 1, background);
  FillFrom(levels[at + 1], levels[at]);
}

/// The colour of pixel `i` of the rows. Requires: it has one.
std::array<uint8_t, 3> ShownAt(const PictureRows& rows, size_t i, const ToneTable& tone) {
  return rows.coverage.empty() ? tone(rows.codes[i]) : tone(rows.codes[i], rows.coverage[i]);
}

}  // namespace

ToneTable::ToneTable(double ev, ToneCurve curve) : ev_(ev), gain_(Exp2(ev)), curve_(curve) {
  for (size_t c = 0; c < 3; ++c) backdrop_[c] = ShownByte(0, gain_, 0, c, curve);
  for (uint32_t exponent = 0; exponent < 32; ++exponent)
    for (uint32_t mantissa = 0; mantissa < 512; ++mantissa) {
      const auto linear = static_cast<double>(UnpackShared(exponent << 27 | mantissa).x) * gain_;
      values_[exponent << 9 | mantissa] = static_cast<uint8_t>(EncodeSrgb(Toned(curve, linear)) * 255 + 0.5);
    }
}

std::array<uint8_t, 3> ToneTable::BeforeBackdrop(uint32_t code, uint8_t coverage) const {
  const glm::vec3 radiance = UnpackShared(code);
  std::array<uint8_t, 3> shown{};
  for (size_t c = 0; c < 3; ++c)
    shown[c] = ShownByte(radiance[static_cast<int>(c)], gain_, static_cast<float>(coverage) / 255, c, curve_);
  return shown;
}

void RgbMaker::Make(const PictureRows& rows, const ToneTable& tone, uint32_t background) {
  const auto& codes = rows.codes;
  rgb_.resize(3 * codes.size());
  if (std::ranges::all_of(codes, [](uint32_t code) { return code < kUntraced; })) {
    for (size_t i = 0; i < codes.size(); ++i) std::ranges::copy(ShownAt(rows, i, tone), &rgb_[3 * i]);
    return;
  }
  const auto pixel = [&](const std::array<uint8_t, 3>& color) {
    return Level::Pixel{color[0], color[1], color[2], 1};
  };
  if (levels_.empty()) levels_.emplace_back();
  levels_[0].Open(rows.width, rows.height());
  for (size_t i = 0; i < codes.size(); ++i)
    if (codes[i] < kUntraced) levels_[0].pixels[i] = pixel(ShownAt(rows, i, tone));
  Fill(pixel(tone(background)));
}

void RgbMaker::MakeSmall(const PictureRows& rows, const ToneTable& tone, uint32_t background, uint32_t step) {
  if (levels_.empty()) levels_.emplace_back();
  Level& small = levels_[0];
  small.Open((rows.width + step - 1) / step, (rows.height() + step - 1) / step);
  for (uint32_t y = 0; y < small.height; ++y)
    for (uint32_t x = 0; x < small.width; ++x) {
      uint32_t r = 0, g = 0, b = 0, known = 0;
      const uint32_t right = std::min((x + 1) * step, rows.width);
      for (uint32_t j = y * step; j < std::min((y + 1) * step, rows.height()); ++j)
        for (uint32_t i = x * step; i < right; ++i) {
          const size_t at = size_t{j} * rows.width + i;
          if (rows.codes[at] >= kUntraced) continue;
          const auto color = ShownAt(rows, at, tone);
          r += color[0];
          g += color[1];
          b += color[2];
          ++known;
        }
      if (known > 0)
        small.at(x, y) = {static_cast<uint16_t>(r / known), static_cast<uint16_t>(g / known),
                          static_cast<uint16_t>(b / known), 1};
    }
  const auto color = tone(background);
  Fill({color[0], color[1], color[2], 1});
}

/// Fills the holes of the first level and takes its colours.
void RgbMaker::Fill(const Level::Pixel& background) {
  FillHoles(levels_, 0, background);
  const auto& pixels = levels_[0].pixels;
  rgb_.resize(3 * pixels.size());
  for (size_t i = 0; i < pixels.size(); ++i) {
    const Level::Pixel& p = pixels[i];
    rgb_[3 * i] = static_cast<uint8_t>(p.r);
    rgb_[3 * i + 1] = static_cast<uint8_t>(p.g);
    rgb_[3 * i + 2] = static_cast<uint8_t>(p.b);
  }
}

FrameEncoder::FrameEncoder() : compressor_(tjInitCompress()) {}

FrameEncoder::~FrameEncoder() {
  if (compressor_) tjDestroy(compressor_);
}

Result<Bytes> FrameEncoder::Jpeg(uint32_t width, uint32_t height, int quality, bool fine) {
  if (!compressor_) return Fail("cannot encode the image: libjpeg-turbo does not start");
  const int w = static_cast<int>(width), h = static_cast<int>(height),
            sampling = fine ? TJSAMP_444 : TJSAMP_420;
  jpeg_.resize(std::max<size_t>(jpeg_.size(), tjBufSize(w, h, sampling)));
  auto* to = reinterpret_cast<unsigned char*>(jpeg_.data());
  unsigned long size = jpeg_.size();
  if (tjCompress2(compressor_, maker_.rgb().data(), w, 0, h, TJPF_RGB, &to, &size, sampling, quality,
                  TJFLAG_NOREALLOC | TJFLAG_FASTDCT) != 0)
    return Fail(fmt::format("cannot encode the image as JPEG: {}", tjGetErrorStr2(compressor_)));
  return Bytes(jpeg_.begin(), jpeg_.begin() + static_cast<std::ptrdiff_t>(size));
}

Result<EncodedFrame> FrameEncoder::Encode(const DueFrame& frame, const SceneFacts& scene, int quality,
                                          std::optional<ToneTable>& tone) {
  const auto start = std::chrono::steady_clock::now();
  EncodedFrame encoded;
  const View& view = frame.wanted.view;
  if (!frame.exact.empty()) {
    const ImageFormat format{"png", {}, frame.wanted.tone};
    QUARRY_ASSIGN(Bytes png, EncodeImage(view, format, scene, frame.exposure, frame.exact));
    encoded.stripes.push_back({0, view.height, 1, true, std::move(png)});
  } else {
    const double ev = frame.exposure - view.range;  // rows hold radiance times 2^range
    const ToneCurve curve = ToneOf({"", {}, frame.wanted.tone}, view.mode);
    if (!tone || !tone->Is(ev, curve)) tone.emplace(ev, curve);
    const uint32_t step = frame.scale;
    const uint32_t background =
        view.backdrop ? kUncovered : PackShared(view.background * std::ldexp(1.0f, view.range));
    for (const PictureRows& rows : frame.rows) {
      const auto small = [step](uint32_t length) { return (length + step - 1) / step; };
      if (step == 1)
        maker_.Make(rows, *tone, background);
      else
        maker_.MakeSmall(rows, *tone, background, step);
      const bool fine = !frame.in_motion || step > 1;
      QUARRY_ASSIGN(Bytes jpeg, Jpeg(small(rows.width), small(rows.height()),
                                     step > 1 ? std::max(quality, kSmallQuality) : quality, fine));
      encoded.stripes.push_back({rows.y, rows.height(), step, false, std::move(jpeg)});
    }
  }
  encoded.encode_s = SecondsSince(start);
  return encoded;
}

}  // namespace quarry
