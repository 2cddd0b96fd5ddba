#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/status.h"
#include "common/scene/scene_views.h"
#include "common/voxel/catalog.h"
#include "common/voxel/parts/part_sections.h"
#include "common/voxel/store_names.h"
#include "common/voxel/texture_sections.h"

namespace quarry {

/// An entry of a store's section table.
struct SectionEntry {
  SectionType type{};
  uint32_t flags = 0;
  uint64_t offset = 0, size = 0, checksum = 0;
};

/// The files that a store was made of.
struct ModelNames {
  uint32_t count = 0;              ///< 0 when unknown: standard input, or a store from before
  std::vector<std::string> names;  ///< of the first kMostModelNames files, without their folders
};

/// A scene store opened for reading; a file is read with pread(), never mapped. Open() reads and checks all
/// but blocks and pages. The catalog, cameras and lights stay in memory; names do not. Thread-safe after
/// Open().
class StoreReader {
 public:
  /// Errors: not a store; another format version (the message has both); truncated or too long; damaged (the
  /// message names the section); a critical section of an unknown type; a section larger than its type may be
  /// (FORMAT.md), before a byte of it is read.
  static Result<StoreReader> Open(const std::string& path);
  static Result<StoreReader> Open(std::unique_ptr<const RandomAccessFile> file);

  const std::string& path() const { return file_->path(); }
  /// Bytes in the file.
  uint64_t size() const { return file_->size(); }
  const Catalog& catalog() const { return catalog_; }
  /// The catalog's sections as stored, for sending.
  const std::vector<Section>& catalog_sections() const { return catalog_sections_; }
  /// Bytes of STRS, which has all names.
  uint64_t name_bytes() const { return names_->bytes(); }
  uint64_t part_count() const { return names_->part_count(); }
  /// The name of a part, material or texture, read from the file; empty when there is none.
  /// Errors: the file cannot be read.
  Result<std::string> PartName(uint32_t part) const { return names_->Part(part); }
  Result<std::string> MaterialName(uint32_t material) const;
  Result<std::string> TextureName(uint32_t texture) const;

  /// The tree of parts, read from the file when asked for. PartTree holds it in memory.
  const PartSections& part_sections() const { return *part_sections_; }
  /// Whether the store states which parts each voxel has. Stores from before do not.
  bool has_parts_of_voxels() const { return part_sections_->has_lists(); }
  /// Calls `each` for all voxels in order, with the parts of the voxel's triangles, ascending; they are valid
  /// during the call. Requires: has_parts_of_voxels(). Errors: as PartListReader.
  Status ForEachVoxelParts(
      const std::function<void(uint32_t voxel, std::span<const uint32_t> parts)>& each) const;

  /// The textures; empty when the store has none.
  const std::vector<Texture>& textures() const { return catalog_.textures; }
  /// The materials' uses of textures, sorted by material, then use.
  const std::vector<MaterialTexture>& material_textures() const { return material_textures_; }

  /// The files that the store was made of. Other programs' bytes: print them as such.
  const ModelNames& models() const { return models_; }

  /// The cameras and lights of the model.
  const SceneViews& views() const { return views_; }

  /// Reads a stored block, of a voxel or a page, and verifies its checksum.
  /// Errors: a read error; permanent: no such block, or a damaged block (the message has its byte offset).
  Result<Bytes> ReadBlock(BlockKey block) const;

  /// Reads a page of a texture and decodes it, as DecodePage().
  /// Errors: a read error; permanent: no such page, or a damaged page (the message has texture, page and
  /// byte).
  Result<Bytes> ReadPage(uint32_t texture, uint32_t page) const;

  /// Reads and decodes every block and page, and checks that they fill their sections without gaps and that
  /// the parts' sections are right. Calls `progress(done, total)` after each voxel and texture. Errors: the
  /// first problem found.
  Status Verify(const std::function<void(uint64_t done, uint64_t total)>& progress) const;

 private:
  friend class StoreVerifier;
  explicit StoreReader(std::unique_ptr<const RandomAccessFile> file) : file_(std::move(file)) {}
  Status ReadHeader();
  Result<std::vector<SectionEntry>> ReadTable(std::span<const std::byte> table, uint32_t count) const;
  Status ReadSections(std::span<const std::byte> table, uint32_t count);
  Status ReadSection(const SectionEntry& entry, std::vector<Section>& views);
  Result<Bytes> ReadBytes(const SectionEntry& entry) const;
  Status CheckBytes(const SectionEntry& entry) const;
  Result<std::string> NameIn(SectionType section, uint64_t at) const;
  Status DecodeViews(const std::vector<Section>& sections);

  std::unique_ptr<const RandomAccessFile> file_;
  SceneId id_{};
  Catalog catalog_;
  std::vector<Section> catalog_sections_;
  std::unique_ptr<const StoreNames> names_;
  std::unique_ptr<const PartSections> part_sections_;
  std::vector<MaterialTexture> material_textures_;
  SceneViews views_;
  ModelNames models_;
  uint64_t blocks_begin_ = 0, blocks_end_ = 0;
  uint64_t pages_begin_ = 0, pages_end_ = 0;
};

/// Errors (usage): the store is an environment's.
Status CheckIsScene(const StoreReader& store);

}  // namespace quarry
