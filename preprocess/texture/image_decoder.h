#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/texture/image_protocol.h"

namespace quarry {

/// How images are decoded.
struct ImageDecoding {
  std::string program;  ///< quarry-import-image; empty: it is not there
  uint64_t memory = 0;  ///< bytes that it may take beyond its libraries
};

/// The helper process that decodes images, started with the first of them and again after one that it crashed
/// on. Requires: SIGPIPE is ignored. Not thread-safe.
class ImageDecoder {
 public:
  explicit ImageDecoder(ImageDecoding decoding) : decoding_(std::move(decoding)) {}
  ~ImageDecoder() { Stop(); }
  ImageDecoder(const ImageDecoder&) = delete;

  using OnFacts = std::function<Status(const ImageFacts&)>;
  using OnRow = std::function<Status(std::span<const std::byte>)>;
  /// Decodes an image: its facts, then all of its rows. Requires: it lies in a file.
  /// Errors, one sentence that names the image: it cannot be read; the decoder crashed; those of the
  /// callbacks. See is_fatal().
  Status Decode(const TextureImage& image, const OnFacts& facts, const OnRow& row);
  /// The facts alone, from the image's header.
  Result<ImageFacts> LookAt(const TextureImage& image);

  /// Whether the last error is no fault of the image: memory does not do, the helper was ended, or cannot be
  /// started, or has never answered; a callback failed.
  bool is_fatal() const { return fatal_; }

 private:
  struct Message {
    ImageMessage kind;
    Bytes bytes;
  };
  Status Start();
  void Stop();
  Status Ask(ImageMessage kind, const TextureImage& image);
  Result<Message> Receive(const TextureImage& image);
  Result<ImageFacts> ReceiveFacts(const TextureImage& image);
  tl::unexpected<Error> Ended(const TextureImage& image);

  ImageDecoding decoding_;
  pid_t child_ = -1;
  int to_ = -1, from_ = -1;
  bool answered_ = false;  ///< anything, ever: the program works
  bool fatal_ = false;
};

}  // namespace quarry
