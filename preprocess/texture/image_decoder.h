#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/import/foreign/helper_process.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/texture/image_protocol.h"

namespace quarry {

/// How to decode images.
struct ImageDecoding {
  std::string program;  ///< quarry-import-image; empty: it is not there
  uint64_t memory = 0;  ///< bytes that it may take beyond its libraries
};

/// The process that decodes images, started with the first image and again after a crash. Requires: SIGPIPE
/// is ignored. Thread safety: none.
class ImageDecoder {
 public:
  explicit ImageDecoder(const ImageDecoding& decoding) : helper_(decoding.program, decoding.memory) {}

  using OnFacts = std::function<Status(const ImageFacts&)>;
  using OnRow = std::function<Status(std::span<const std::byte>)>;
  using OnRows = std::function<Status(Bytes)>;
  /// Decodes an image: calls `facts`, then passes all rows, many at a time. Requires: the image lies in a
  /// file. Errors, a sentence with the image's name: cannot be read; the decoder crashed; the callbacks'. See
  /// is_fatal().
  Status DecodeRows(const TextureImage& image, const OnFacts& facts, const OnRows& rows);
  /// Likewise, row by row.
  Status Decode(const TextureImage& image, const OnFacts& facts, const OnRow& row);
  /// The facts from the image's header alone. Errors: as Decode().
  Result<ImageFacts> LookAt(const TextureImage& image);

  /// The fault of the last image, which the decoder read nevertheless: a sentence with the image's name.
  /// Empty: no fault.
  const std::string& remark() const { return remark_; }

  /// Whether the last error is not the image's fault: too little memory; the helper was killed, cannot be
  /// started or has never answered; a callback failed.
  bool is_fatal() const { return fatal_; }

 private:
  struct Message {
    ImageMessage kind;
    Bytes bytes;
  };
  Status Start();
  Status Ask(ImageMessage kind, const TextureImage& image);
  Result<Message> Receive(const TextureImage& image);
  Result<ImageFacts> ReceiveFacts(const TextureImage& image);
  tl::unexpected<Error> Ended(const TextureImage& image);

  HelperProcess helper_;
  bool answered_ = false;  ///< at least once: the program works
  bool fatal_ = false;
  std::string remark_;
};

}  // namespace quarry
