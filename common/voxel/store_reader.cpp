#include "common/voxel/store_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/file.h"
#include "common/voxel/store_format.h"
#include "common/voxel/store_header.h"
#include "common/voxel/texture_page.h"
#include "common/voxel/view_sections.h"

namespace quarry {
namespace {

bool IsCatalogSection(SectionType type) {
  return type == SectionType::kMeta || type == SectionType::kTopTree || type == SectionType::kDirectory ||
         type == SectionType::kMaterials || type == SectionType::kTextureDirectory ||
         type == SectionType::kMaterialTextures;
}

bool IsKnown(SectionType type) {
  return IsCatalogSection(type) || type == SectionType::kParts || type == SectionType::kStrings ||
         type == SectionType::kBlocks || type == SectionType::kProxies ||
         type == SectionType::kTexturePages || type == SectionType::kCameras || type == SectionType::kLights;
}

std::string TypeName(SectionType type) {
  std::string name;
  for (int i = 0; i < 4; ++i) {
    const char c = static_cast<char>(static_cast<uint32_t>(type) >> (8 * i));
    name += c >= ' ' && c <= '~' ? c : '?';
  }
  return name;
}

/// An error that a retry cannot help.
tl::unexpected<Error> FailForGood(std::string sentence) {
  return tl::unexpected<Error>(Error{std::move(sentence), ErrorKind::kPermanent});
}

}  // namespace

Result<StoreReader> StoreReader::Open(const std::string& path) {
  QUARRY_ASSIGN(InputFile file, InputFile::Open(path));
  return Open(std::make_unique<InputFile>(std::move(file)));
}

Result<StoreReader> StoreReader::Open(std::unique_ptr<const RandomAccessFile> file) {
  StoreReader reader(std::move(file));
  QUARRY_TRY(reader.ReadHeader());
  return reader;
}

Status StoreReader::ReadHeader() {
  Bytes bytes(std::min(kStoreHeaderBytes, file_->size()));
  QUARRY_TRY(file_->ReadAt(0, bytes));
  QUARRY_ASSIGN(const StoreHeader header, DecodeStoreHeader(bytes, path()));
  if (header.file_size != file_->size())
    return Fail(fmt::format("{}: {} bytes long, should be {}: truncated or added to", path(), file_->size(),
                            header.file_size));
  id_ = header.id;
  Bytes table(header.table_bytes());
  QUARRY_TRY(file_->ReadAt(kStoreHeaderBytes, table));
  QUARRY_TRY(CheckStoreTable(header, table, path()));
  return ReadSections(table, header.sections);
}

Status StoreReader::ReadSections(std::span<const std::byte> table, uint32_t count) {
  std::vector<Section> named;
  ByteReader in(table);
  uint64_t end = kStoreHeaderBytes + table.size();
  for (uint32_t i = 0; i < count; ++i) {
    const auto type = static_cast<SectionType>(in.Get<uint32_t>());
    const auto flags = in.Get<uint32_t>();
    const auto offset = in.Get<uint64_t>();
    const auto size = in.Get<uint64_t>();
    const auto checksum = in.Get<uint64_t>();
    in.Get<uint64_t>();  // reserved
    if (offset != end || size > file_->size() - offset)
      return Fail(fmt::format("{}: section {} is not where it should be", path(), TypeName(type)));
    end = offset + size;
    if (!IsKnown(type) && (flags & kSectionCritical))
      return Fail(
          fmt::format("{}: needs a newer program: section {} is not known here", path(), TypeName(type)));
    if (type == SectionType::kBlocks) {
      blocks_begin_ = offset;
      blocks_end_ = end;
    } else if (type == SectionType::kTexturePages) {
      pages_begin_ = offset;
      pages_end_ = end;
    }
    if (flags & kSectionOwnChecksums) continue;
    Section section{type, Bytes(size)};
    QUARRY_TRY(file_->ReadAt(offset, section.bytes));
    if (Checksum(section.bytes) != checksum)
      return Fail(fmt::format("{}: section {} at byte {} is damaged (checksum); make the store again", path(),
                              TypeName(type), offset));
    if (IsCatalogSection(type))
      catalog_sections_.push_back(std::move(section));
    else if (IsKnown(type))
      named.push_back(std::move(section));
  }
  if (end != file_->size())
    return Fail(fmt::format("{}: {} bytes after the last section", path(), file_->size() - end));
  TexturePlaces places{{}, pages_begin_, pages_end_};
  for (const Section& s : named)
    if (s.type == SectionType::kStrings) places.strings = AsText(s.bytes);
  auto catalog = DecodeCatalog(id_, catalog_sections_, places);
  if (!catalog) return Fail(fmt::format("{}: {}", path(), catalog.error().message));
  catalog_ = std::move(*catalog);
  for (uint32_t m = 0; m < catalog_.materials.size(); ++m)
    for (const TextureBinding& binding : catalog_.materials[m].textures)
      material_textures_.push_back({m, binding});
  QUARRY_TRY(DecodeNames(named));
  const Status views = DecodeViews(named);
  if (!views) return Fail(fmt::format("{}: {}", path(), views.error().message));
  return {};
}

Status StoreReader::DecodeViews(const std::vector<Section>& sections) {
  std::string_view strings;
  for (const Section& s : sections)
    if (s.type == SectionType::kStrings) strings = AsText(s.bytes);
  for (const Section& s : sections) {
    if (s.type == SectionType::kCameras) {
      QUARRY_ASSIGN(views_.cameras, DecodeCameras(s.bytes, strings));
    } else if (s.type == SectionType::kLights) {
      QUARRY_ASSIGN(views_.lights, DecodeLights(s.bytes, strings));
    }
  }
  return {};
}

Status StoreReader::DecodeNames(const std::vector<Section>& sections) {
  std::string_view strings;
  std::span<const std::byte> parts;
  for (const Section& s : sections) {
    if (s.type == SectionType::kStrings) strings = AsText(s.bytes);
    if (s.type == SectionType::kParts) parts = s.bytes;
  }
  ByteReader in(parts);
  while (in.remaining() >= 4) parts_.push_back(StringAt(strings, in.Get<uint32_t>()));
  for (const Section& s : catalog_sections_) {
    if (s.type != SectionType::kMaterials) continue;
    ByteReader materials(s.bytes);
    const auto count = materials.Get<uint32_t>();
    const size_t entry = count ? materials.remaining() / count : 0;
    for (uint32_t i = 0; i < count; ++i)
      material_names_.push_back(StringAt(strings, ByteReader(materials.GetSpan(entry)).Get<uint32_t>()));
  }
  return {};
}

Result<Bytes> StoreReader::ReadBlock(BlockKey block) const {
  if (!catalog_.Has(block))
    return FailForGood(fmt::format("{}: there is no block {}", path(), block.number()));
  const BlockEntry& entry = catalog_.block(block);
  const bool page = catalog_.IsPage(block);
  const uint64_t begin = page ? pages_begin_ : blocks_begin_, end = page ? pages_end_ : blocks_end_;
  if (entry.offset < begin || entry.offset > end || entry.stored > end - entry.offset)
    return FailForGood(fmt::format("{}: block {} is not where it should be", path(), block.number()));
  Bytes bytes(entry.stored);
  QUARRY_TRY(file_->ReadAt(entry.offset, bytes));
  if (Checksum(bytes) != entry.checksum)
    return FailForGood(fmt::format("{}: block {} at byte {} is damaged (checksum); make the store again",
                                   path(), block.number(), entry.offset));
  return bytes;
}

Result<Bytes> StoreReader::ReadPage(uint32_t texture, uint32_t page) const {
  if (texture >= textures().size() || page >= textures()[texture].pages.size())
    return FailForGood(fmt::format("{}: there is no page {} of texture {}", path(), page, texture));
  const auto damaged = [&](const std::string& how) {
    return FailForGood(fmt::format("{}: page {} of texture {} ({}) at byte {}: {}; make the store again",
                                   path(), page, texture, textures()[texture].name,
                                   textures()[texture].pages[page].offset, how));
  };
  const BlockEntry& entry = textures()[texture].pages[page];
  Bytes stored(entry.stored);
  QUARRY_TRY(file_->ReadAt(entry.offset, stored));
  if (Checksum(stored) != entry.checksum) return damaged("is damaged (checksum)");
  Result<Bytes> texels = DecodePage(catalog_.shapes[texture], textures()[texture].layout, page, stored);
  if (!texels) return damaged(texels.error().message);
  return texels;
}

Status StoreReader::VerifyTexture(uint32_t texture) const {
  for (uint32_t p = 0; p < textures()[texture].pages.size(); ++p)
    QUARRY_TRY(ReadPage(texture, p).map([](auto&&) {}));
  return {};
}

/// Checks that the pages fill their section without gaps. Pages lie in the order in which they were
/// completed.
Status StoreReader::CheckPagesFill() const {
  std::vector<std::pair<uint64_t, uint64_t>> places;
  for (const Texture& t : textures())
    for (const BlockEntry& page : t.pages) places.emplace_back(page.offset, page.offset + page.stored);
  std::ranges::sort(places);
  uint64_t end = pages_begin_;
  for (const auto& [first, last] : places) {
    if (first != end)
      return Fail(fmt::format("{}: the page at byte {} is not where it should be", path(), first));
    end = last;
  }
  if (end == pages_end_) return {};
  return Fail(fmt::format("{}: the pages end at byte {}, their section at {}", path(), end, pages_end_));
}

Status StoreReader::VerifyVoxel(uint32_t voxel, uint64_t& end, BlockDecoder& decoder) const {
  for (BlockKind kind : {BlockKind::kHot, BlockKind::kShading}) {
    const BlockKey id = kind == BlockKind::kHot ? BlockKey::Hot(voxel) : BlockKey::Shading(voxel);
    const BlockEntry& entry = catalog_.block(id);
    if (entry.offset != end)
      return Fail(fmt::format("{}: block {} is not where it should be", path(), id.number()));
    end += entry.stored;
    if (entry.stored == 0) continue;
    QUARRY_ASSIGN(const Bytes stored, ReadBlock(id));
    Bytes decoded(entry.decoded);
    const Status status =
        kind == BlockKind::kHot
            ? DecodeHot(decoder, catalog_, voxel, stored, decoded).and_then([&](const VoxelGeometry& v) {
                return CheckBounds(v, voxel);
              })
            : DecodeShading(decoder, catalog_, voxel, stored, decoded).map([](auto&&) {});
    if (!status)
      return Fail(fmt::format("{}: block {} at byte {}: {}", path(), id.number(), entry.offset,
                              status.error().message));
  }
  return {};
}

/// Checks that the directory's box of a voxel is the box of its triangles.
Status StoreReader::CheckBounds(const VoxelGeometry& geometry, uint32_t voxel) const {
  const VoxelEntry& entry = catalog_.voxels[voxel];
  const Box box = BoundsOf({geometry.vertices, geometry.vertex_count});
  if (box.lower == entry.bounds_lower && box.upper == entry.bounds_upper) return {};
  return Fail("its triangles lie elsewhere than the VDIR section says");
}

Status StoreReader::CheckBlocksEnd(uint64_t end) const {
  if (end == blocks_end_) return {};
  return Fail(fmt::format("{}: the blocks end at byte {}, their section at {}", path(), end, blocks_end_));
}

}  // namespace quarry
