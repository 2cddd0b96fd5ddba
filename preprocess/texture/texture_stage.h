#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/progress.h"
#include "common/base/status.h"
#include "common/voxel/store_writer.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/texture/image_decoder.h"

namespace quarry {

/// What became of a scene's images.
struct TextureStatistics {
  uint64_t textures = 0, pages = 0;
  uint64_t stored_bytes = 0, decoded_bytes = 0;  ///< of pages
  uint64_t left_out = 0;                         ///< images that cannot be read
  double wall_s = 0;
};

/// Images into textures of the store, one after the other: decoded by the helper row by row, made into pages
/// as rows come. An image that cannot be read is warned of and left out. Memory: kPageSide rows of each
/// level, 34 MB for the largest image there may be.
class TextureStage {
 public:
  using Warn = std::function<void(const std::string&)>;
  TextureStage(const std::vector<TextureImage>& images, ImageDecoding decoding, unsigned threads, Warn warn)
      : images_(images), decoder_(std::move(decoding)), threads_(threads), warn_(std::move(warn)) {}

  /// What an earlier run had done, as its notes say, in order; `textures` is for the writer.
  /// Errors: a note that cannot be read.
  Status Restore(std::span<const std::byte> note, std::vector<WrittenTexture>& textures);
  /// Carries the rest; `note` is called now and then, after the writer's file has been synchronised, with
  /// what was done since the last time. Errors: disk full, memory that does not do.
  Status Run(StoreWriter& writer, Progress& progress, const std::function<Status(const Bytes&)>& note);
  /// Numbers the textures of bindings as the store does; bindings of images left out go.
  void Renumber(std::vector<Material>& materials) const;
  /// What was done since the last note, as a note.
  Bytes TakeUnsaved(const StoreWriter& writer);
  TextureStatistics Statistics(const StoreWriter& writer) const;

 private:
  Status Carry(const TextureImage& image, StoreWriter& writer);

  const std::vector<TextureImage>& images_;
  ImageDecoder decoder_;
  unsigned threads_;
  Warn warn_;
  std::vector<uint32_t> numbers_;  ///< of the images done: the store's texture, or kNoIndex
  size_t saved_ = 0;
  uint32_t pages_ = 0;  ///< of the images done
  double wall_s_ = 0;
};

}  // namespace quarry
