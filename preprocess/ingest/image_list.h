#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/status.h"
#include "preprocess/import/texture_image.h"

namespace quarry {

/// The images of a scene, without repetition. Images that a model holds as text are written to a file of the
/// work folder, so that every image lies in a file. Thread safety: none.
class ImageList {
 public:
  /// `path`: of the file for images that models hold as text.
  explicit ImageList(std::string path) : path_(std::move(path)) {}

  /// The image's index; the same bytes for the same use share it. Errors: more than kMaxTextures; disk full.
  Result<uint32_t> Add(TextureImage image);
  const std::vector<TextureImage>& images() const { return images_; }

  /// Makes the file durable and appends the state that Restore() needs to `out`.
  Status Save(ByteWriter& out);
  /// Errors: the bytes cannot be read; an image's file has changed or is gone.
  Status Restore(ByteReader& in);
  /// The images, after the last. Their files can be read. Errors: disk full.
  Result<std::vector<TextureImage>> Finish();

 private:
  static std::string KeyOf(const TextureImage& image);
  Status OpenFile(uint64_t size);

  std::string path_;
  std::optional<OutputFile> file_;
  std::vector<TextureImage> images_;
  std::vector<std::string> identities_;  ///< FileIdentity() of each image's file
  std::unordered_map<std::string, uint32_t> known_;
};

}  // namespace quarry
