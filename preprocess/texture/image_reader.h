#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/texture/image_decoder.h"

namespace quarry {

/// Decodes images one after the other on a thread of its own, ahead of the caller: by up to 6 messages of
/// about 1 MB, which may be of the next images. Requires: `images` outlive the object. Thread safety: one
/// caller.
class ImageReader {
 public:
  /// Begins with image number `first`.
  ImageReader(const std::vector<TextureImage>& images, size_t first, ImageDecoding decoding);
  ~ImageReader();

  /// A piece of an image: first its facts, then rows, at last the end; the end alone if it cannot be read.
  struct Piece {
    enum class Kind { kFacts, kRows, kEnd } kind = Kind::kEnd;
    ImageFacts facts;
    Bytes rows;          ///< whole rows
    Status status;       ///< at the end: why the image cannot be read
    bool fatal = false;  ///< ImageDecoder::is_fatal(); nothing follows
    std::string remark;  ///< at the end: ImageDecoder::remark()
  };
  /// Waits for the next piece. Requires: images remain, and none was fatal.
  Piece Next();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry
