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

/// The images of a scene, without repetition: the same file, or the same bytes in another place, for the same
/// use is one image. Images that a model holds as text are written to a file of the work folder, so that
/// every image lies in a file. Thread safety: none.
class ImageList {
 public:
  /// `path`: of the file for images that models hold as text.
  explicit ImageList(std::string path) : path_(std::move(path)) {}

  /// The image's index; the same bytes for the same use share it. Errors: more than kMaxTextures; disk full.
  Result<uint32_t> Add(TextureImage image);
  const std::vector<TextureImage>& images() const { return images_; }

  /// Writes the file out and appends the state that Restore() needs to `out`.
  Status Save(ByteWriter& out);
  /// Restores the list for Finish(). Bytes that end too early make `in` not ok(). Errors: the file is shorter
  /// than it was.
  Status Restore(ByteReader& in);
  /// The images, after the last. Their files can be read. Errors: disk full.
  Result<std::vector<TextureImage>> Finish();

 private:
  /// Size and digest, equal for images with equal bytes; digests are compared only where the sizes are equal.
  struct Content {
    uint64_t size;
    std::string digest;  ///< of the bytes; empty until another image has as many
  };
  static std::string KeyOf(const TextureImage& image);
  Status OpenFile(uint64_t size);
  uint32_t FindEqual(const TextureImage& image, Content& content);
  void Know(TextureImage image, Content content);

  std::string path_;
  std::optional<OutputFile> file_;
  std::vector<TextureImage> images_;
  std::vector<Content> contents_;                      ///< of each image
  std::unordered_map<std::string, uint32_t> known_;    ///< image of each key, keys of aliases too
  std::unordered_multimap<uint64_t, uint32_t> sized_;  ///< images by the size of their bytes
};

}  // namespace quarry
