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

/// The images of a scene, each use of one once. What a model holds as text is put into one file of the work
/// folder, so that all lie in files. Not thread-safe.
class ImageList {
 public:
  /// `path`: of the file for images that are in none.
  explicit ImageList(std::string path) : path_(std::move(path)) {}

  /// The image's index. Errors: more than kMaxTextures; disk full.
  Result<uint32_t> Add(TextureImage image);
  const std::vector<TextureImage>& images() const { return images_; }

  /// Makes the file outlast a loss of power, and appends what Restore needs to `out`.
  Status Save(ByteWriter& out);
  /// Errors: the bytes cannot be read; an image's file is another than it was, or is gone.
  Status Restore(ByteReader& in);
  /// After the last image: the file can be read.
  Result<std::vector<TextureImage>> Finish();

 private:
  static std::string KeyOf(const TextureImage& image);
  Status OpenFile(uint64_t size);

  std::string path_;
  std::optional<OutputFile> file_;
  std::vector<TextureImage> images_;
  std::vector<std::string> identities_;  ///< of their files
  std::unordered_map<std::string, uint32_t> known_;
};

}  // namespace quarry
