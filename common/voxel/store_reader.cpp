#include "common/voxel/store_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/voxel/store_format.h"
#include "common/voxel/store_header.h"

namespace quarry {
namespace {

bool IsCatalogSection(SectionType type) {
  return type == SectionType::kMeta || type == SectionType::kTopTree || type == SectionType::kDirectory ||
         type == SectionType::kMaterials;
}

bool IsKnown(SectionType type) {
  return IsCatalogSection(type) || type == SectionType::kParts || type == SectionType::kStrings ||
         type == SectionType::kBlocks || type == SectionType::kProxies || type == SectionType::kTextures;
}

std::string TypeName(SectionType type) {
  std::string name;
  for (int i = 0; i < 4; ++i) {
    const char c = static_cast<char>(static_cast<uint32_t>(type) >> (8 * i));
    name += c >= ' ' && c <= '~' ? c : '?';
  }
  return name;
}

/// Trying again cannot help.
tl::unexpected<Error> FailForGood(std::string sentence) {
  return tl::unexpected<Error>(Error{std::move(sentence), 1, true});
}

/// The zero-terminated string at `offset` of `strings`, or empty.
std::string StringAt(std::string_view strings, uint32_t offset) {
  if (offset >= strings.size()) return {};
  const std::string_view rest = strings.substr(offset);
  return std::string(rest.substr(0, rest.find('\0')));
}

}  // namespace

Result<StoreReader> StoreReader::Open(const std::string& path) {
  QUARRY_ASSIGN(InputFile file, InputFile::Open(path));
  StoreReader reader(std::move(file));
  QUARRY_TRY(reader.ReadHeader());
  return reader;
}

Status StoreReader::ReadHeader() {
  Bytes bytes(std::min(kStoreHeaderBytes, file_.size()));
  QUARRY_TRY(file_.ReadAt(0, bytes));
  QUARRY_ASSIGN(const StoreHeader header, DecodeStoreHeader(bytes, path()));
  if (header.file_size != file_.size())
    return Fail(fmt::format("{}: {} bytes long, should be {}: truncated or added to", path(), file_.size(),
                            header.file_size));
  id_ = header.id;
  Bytes table(header.table_bytes());
  QUARRY_TRY(file_.ReadAt(kStoreHeaderBytes, table));
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
    if (offset != end || size > file_.size() - offset)
      return Fail(fmt::format("{}: section {} is not where it should be", path(), TypeName(type)));
    end = offset + size;
    if (!IsKnown(type) && (flags & kSectionCritical))
      return Fail(
          fmt::format("{}: needs a newer program: section {} is not known here", path(), TypeName(type)));
    if (type == SectionType::kBlocks) {
      blocks_begin_ = offset;
      blocks_end_ = end;
    }
    if (flags & kSectionOwnChecksums) continue;
    Section section{type, Bytes(size)};
    QUARRY_TRY(file_.ReadAt(offset, section.bytes));
    if (Checksum(section.bytes) != checksum)
      return Fail(fmt::format("{}: section {} at byte {} is damaged (checksum); make the store again", path(),
                              TypeName(type), offset));
    if (IsCatalogSection(type))
      catalog_sections_.push_back(std::move(section));
    else if (IsKnown(type))
      named.push_back(std::move(section));
  }
  if (end != file_.size())
    return Fail(fmt::format("{}: {} bytes after the last section", path(), file_.size() - end));
  auto catalog = DecodeCatalog(id_, catalog_sections_);
  if (!catalog) return Fail(fmt::format("{}: {}", path(), catalog.error().message));
  catalog_ = std::move(*catalog);
  return DecodeNames(named);
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

Result<Bytes> StoreReader::ReadBlock(uint32_t block_id) const {
  if (block_id / 2 >= catalog_.voxels.size() || catalog_.block(block_id).stored == 0)
    return FailForGood(fmt::format("{}: there is no block {}", path(), block_id));
  const BlockEntry& entry = catalog_.block(block_id);
  if (entry.offset < blocks_begin_ || entry.stored > blocks_end_ - entry.offset || entry.offset > blocks_end_)
    return FailForGood(fmt::format("{}: block {} is not where it should be", path(), block_id));
  Bytes bytes(entry.stored);
  QUARRY_TRY(file_.ReadAt(entry.offset, bytes));
  if (Checksum(bytes) != entry.checksum)
    return FailForGood(fmt::format("{}: block {} at byte {} is damaged (checksum); make the store again",
                                   path(), block_id, entry.offset));
  return bytes;
}

Status StoreReader::VerifyVoxel(uint32_t voxel, uint64_t& end, BlockDecoder& decoder) const {
  for (BlockKind kind : {BlockKind::kHot, BlockKind::kShading}) {
    const uint32_t id = BlockId(voxel, kind);
    const BlockEntry& entry = catalog_.block(id);
    if (entry.offset != end) return Fail(fmt::format("{}: block {} is not where it should be", path(), id));
    end += entry.stored;
    if (entry.stored == 0) continue;
    QUARRY_ASSIGN(const Bytes stored, ReadBlock(id));
    Bytes decoded(entry.decoded);
    const Status status = kind == BlockKind::kHot
                              ? decoder.Hot(stored, decoded, catalog().meta.padding).map([](auto&&) {})
                              : decoder.Shading(stored, decoded).map([](auto&&) {});
    if (!status)
      return Fail(
          fmt::format("{}: block {} at byte {}: {}", path(), id, entry.offset, status.error().message));
  }
  return {};
}

Status StoreReader::CheckBlocksEnd(uint64_t end) const {
  if (end == blocks_end_) return {};
  return Fail(fmt::format("{}: the blocks end at byte {}, their section at {}", path(), end, blocks_end_));
}

}  // namespace quarry
