#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/status.h"
#include "common/scene/scene_views.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/catalog.h"
#include "common/voxel/texture_sections.h"

namespace quarry {

/// A scene store opened for reading (pread, never mapped). Opening reads and checks all but the blocks.
/// Thread-safe after Open.
class StoreReader {
 public:
  /// Errors: not a store, another format version (both named), truncated or longer than it says, damaged (the
  /// section named), a critical section of an unknown type.
  static Result<StoreReader> Open(const std::string& path);

  const std::string& path() const { return file_.path(); }
  uint64_t size() const { return file_.size(); }
  const Catalog& catalog() const { return catalog_; }
  /// The catalog's sections as stored, to send on.
  const std::vector<Section>& catalog_sections() const { return catalog_sections_; }
  const std::vector<std::string>& material_names() const { return material_names_; }
  const std::vector<std::string>& parts() const { return parts_; }

  /// Empty where there are none.
  const std::vector<Texture>& textures() const { return textures_; }
  /// By rising material, then use.
  const std::vector<MaterialTexture>& material_textures() const { return material_textures_; }

  /// Cameras and lights that the model brought.
  const SceneViews& views() const { return views_; }

  /// Bytes of one stored block, its checksum verified.
  /// Errors: a read error; permanent: no such block, or a damaged one (the byte offset named).
  Result<Bytes> ReadBlock(BlockKey block) const;

  /// One page of a texture, read, checked and decoded: as DecodePage gives it.
  /// Errors: a read error; permanent: no such page, or a damaged one (the texture, the page and the byte
  /// named).
  Result<Bytes> ReadPage(uint32_t texture, uint32_t page) const;

  /// Reads every block and page and decodes it; also that they fill their sections without a gap.
  /// `progress(done, total)` is called now and then with voxels and textures.
  template <class Progress>
  Status Verify(Progress&& progress) const {
    uint64_t end = blocks_begin_;
    BlockDecoder decoder;
    const size_t voxels = catalog_.voxels.size(), all = voxels + textures_.size();
    for (uint32_t v = 0; v < voxels; ++v) {
      QUARRY_TRY(VerifyVoxel(v, end, decoder));
      progress(v + 1, all);
    }
    QUARRY_TRY(CheckBlocksEnd(end));
    for (uint32_t t = 0; t < textures_.size(); ++t) {
      QUARRY_TRY(VerifyTexture(t));
      progress(voxels + t + 1, all);
    }
    return CheckPagesFill();
  }

 private:
  explicit StoreReader(InputFile file) : file_(std::move(file)) {}
  Status ReadHeader();
  Status ReadSections(std::span<const std::byte> table, uint32_t count);
  Status DecodeNames(const std::vector<Section>& sections);
  Status VerifyVoxel(uint32_t voxel, uint64_t& end, BlockDecoder& decoder) const;
  Status CheckBounds(const VoxelGeometry& geometry, uint32_t voxel) const;
  Status CheckBlocksEnd(uint64_t end) const;
  Status DecodeTextureSections(const std::vector<Section>& sections);
  Status DecodeViews(const std::vector<Section>& sections);
  Status VerifyTexture(uint32_t texture) const;
  Status CheckPagesFill() const;

  InputFile file_;
  SceneId id_{};
  Catalog catalog_;
  std::vector<Section> catalog_sections_;
  std::vector<std::string> material_names_;
  std::vector<std::string> parts_;
  std::vector<Texture> textures_;
  std::vector<MaterialTexture> material_textures_;
  SceneViews views_;
  uint64_t blocks_begin_ = 0, blocks_end_ = 0;
  uint64_t pages_begin_ = 0, pages_end_ = 0;
};

}  // namespace quarry
