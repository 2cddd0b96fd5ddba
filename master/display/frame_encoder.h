#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "master/display/view_pacer.h"
#include "master/pictures/image_output.h"

namespace quarry {

/// A table from shared-exponent codes to 8 bits of sRGB for one exposure and tone curve, the same bits as in
/// PNGs. Uncovered
/// pixels show kBackdrop. Immutable.
class ToneTable {
 public:
  /// `ev`: exposure.
  explicit ToneTable(double ev, ToneCurve curve = ToneCurve::kClip);
  bool Is(double ev, ToneCurve curve) const { return ev == ev_ && curve == curve_; }
  /// The three channels of a code from PackShared().
  std::array<uint8_t, 3> operator()(uint32_t code) const {
    if (code == kUncovered) return backdrop_;
    const uint32_t exponent = code >> 27 << 9;
    return {values_[exponent | (code & 511)], values_[exponent | (code >> 9 & 511)],
            values_[exponent | (code >> 18 & 511)]};
  }
  /// The same for a code that covers a part of its pixel. Units: `coverage` in 255ths.
  std::array<uint8_t, 3> operator()(uint32_t code, uint8_t coverage) const {
    return coverage == 255 || code == kUncovered ? (*this)(code) : BeforeBackdrop(code, coverage);
  }

 private:
  std::array<uint8_t, 3> BeforeBackdrop(uint32_t code, uint8_t coverage) const;

  double ev_, gain_;
  ToneCurve curve_;
  std::array<uint8_t, 3> backdrop_;
  std::array<uint8_t, size_t{32} * 512> values_;  ///< by exponent and mantissa
};

/// Makes 8-bit sRGB of rows. Its memory is kept from frame to frame: the system gives new memory page by
/// page, which costs more than all the rest. Not thread-safe.
class RgbMaker {
 public:
  /// A level of the pyramid from which pixels without a colour are filled.
  struct Level {
    struct Pixel {
      uint16_t r = 0, g = 0, b = 0, known = 0;
    };
    void Open(uint32_t w, uint32_t h) {
      width = w;
      height = h;
      pixels.assign(size_t{w} * h, {});
    }
    Pixel& at(uint32_t x, uint32_t y) { return pixels[size_t{y} * width + x]; }
    const Pixel& at(uint32_t x, uint32_t y) const { return pixels[size_t{y} * width + x]; }

    uint32_t width = 0, height = 0;
    std::vector<Pixel> pixels;
  };

  /// Pixels without a colour get one from their neighbours, near ones first. If no pixel has a colour, all
  /// get `background` (a code).
  void Make(const PictureRows& rows, const ToneTable& tone, uint32_t background);
  /// A pixel for each square of `step` x `step`: the mean of those pixels that have a colour; squares without
  /// one are filled as above. Squares at the borders may be cut.
  void MakeSmall(const PictureRows& rows, const ToneTable& tone, uint32_t background, uint32_t step);
  /// Three bytes a pixel, row by row.
  const std::vector<uint8_t>& rgb() const { return rgb_; }

 private:
  void Fill(const Level::Pixel& background);

  std::vector<uint8_t> rgb_;
  std::vector<Level> levels_;
};

/// An encoded part of a frame: all columns from row `y` on.
struct Stripe {
  uint32_t y = 0, height = 0;
  uint32_t scale = 1;  ///< side of the squares that the image has one pixel each of
  bool png = false;    ///< else JPEG
  Bytes image;
};

struct EncodedFrame {
  std::vector<Stripe> stripes;
  double encode_s = 0;
};

/// Encodes frames for viewers. Keeps its compressor and memory from frame to frame. Not thread-safe, but
/// several threads may use it one after the other.
class FrameEncoder {
 public:
  FrameEncoder();
  ~FrameEncoder();
  FrameEncoder(const FrameEncoder&) = delete;
  FrameEncoder& operator=(const FrameEncoder&) = delete;

  /// An exact frame becomes the PNG of EncodeImage(). Any other frame becomes a JPEG for each run of rows,
  /// with one pixel for each square of DueFrame::scale; the browser stretches it. `tone`: of the viewer's
  /// last frame. `quality`: of JPEG, in [1, 100]. Errors: the libraries' own.
  Result<EncodedFrame> Encode(const DueFrame& frame, const SceneFacts& scene, int quality,
                              std::optional<ToneTable>& tone);

 private:
  Result<Bytes> Jpeg(uint32_t width, uint32_t height, int quality, bool fine);

  void* compressor_;  ///< tjhandle
  RgbMaker maker_;
  Bytes jpeg_;  ///< room for a compressed image
};

}  // namespace quarry
