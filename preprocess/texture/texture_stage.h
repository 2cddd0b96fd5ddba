#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/progress.h"
#include "common/base/status.h"
#include "common/voxel/store_writer.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/texture/image_decoder.h"
#include "preprocess/texture/image_reader.h"
#include "preprocess/texture/page_pipeline.h"

namespace quarry {

/// Statistics of a scene's images.
struct TextureStatistics {
  uint64_t textures = 0, pages = 0;
  uint64_t stored_bytes = 0, decoded_bytes = 0;  ///< of texture pages
  uint64_t left_out = 0;                         ///< images that cannot be read
  double wall_s = 0;
};

/// Carries a scene's images into the store, one after the other: the helper process decodes rows, which
/// become pages as they come; the next image is decoded while one is packed. An image whose texels an earlier
/// one has is stored once. An image that cannot be read is left out with a warning. Memory: kPageSide rows of
/// each level, 34 MB for the largest image allowed. Thread safety: none.
class TextureStage {
 public:
  using Warn = std::function<void(const std::string&)>;
  TextureStage(const std::vector<TextureImage>& images, ImageDecoding decoding, unsigned threads, Warn warn)
      : images_(images), decoding_(std::move(decoding)), threads_(threads), warn_(std::move(warn)) {}

  /// Takes over an earlier run's work from a checkpoint; call it for each in order. `textures`: for the
  /// store's writer. Errors: the checkpoint cannot be read.
  Status Restore(std::span<const std::byte> checkpoint, std::vector<WrittenTexture>& textures);
  /// Carries the remaining images. `save` is called now and then with a checkpoint of the images since the
  /// last, after the writer's file has been written out. Errors: disk full; too little memory.
  Status Run(StoreWriter& writer, Progress& progress, const std::function<Status(const Bytes&)>& save);
  /// Renumbers the materials' bindings to the store's textures. Removes bindings to images left out, and
  /// opacity bindings to images without alpha. Heights that are a normal map by their mean colour become
  /// normals. Where a texture gives the opacity, the material's own no longer counts.
  void Renumber(std::vector<Material>& materials, const StoreWriter& writer) const;
  /// A checkpoint of the images carried since the last.
  Bytes TakeUnsaved(const StoreWriter& writer);
  TextureStatistics Statistics(const StoreWriter& writer) const;

 private:
  Status Carry(const TextureImage& image, ImageReader& reader, PagePipeline& pages, StoreWriter& writer);
  Status Begin(const TextureImage& image, const TexelLayout& layout, StoreWriter& writer) const;
  Status Settle(bool of_normals, StoreWriter& writer);
  uint32_t FindEqual(const WrittenTexture& texture, std::span<const WrittenTexture> earlier) const;
  void Know(const WrittenTexture& texture, uint32_t number);

  const std::vector<TextureImage>& images_;
  ImageDecoding decoding_;
  unsigned threads_;
  Warn warn_;
  std::vector<uint32_t> numbers_;  ///< of each image done: the store's texture, or kNoIndex
  std::unordered_multimap<uint64_t, uint32_t> texels_;  ///< textures by a checksum of their pages'
  std::vector<bool> normals_;     ///< of each image done: whether it is a normal map by its mean colour
  std::vector<bool> of_normals_;  ///< whether each texture is a normal map, by its mean
  size_t saved_ = 0;              ///< images that checkpoints have
  uint32_t saved_textures_ = 0;
  uint32_t pages_ = 0;  ///< of the images done
  double wall_s_ = 0;
};

}  // namespace quarry
