#include "common/voxel/store_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/file.h"
#include "common/voxel/emitters/emitter_section.h"
#include "common/voxel/store_header.h"
#include "common/voxel/store_verifier.h"
#include "common/voxel/texture_page.h"
#include "common/voxel/view_sections.h"

namespace quarry {
namespace {

constexpr uint64_t kUnlimited = ~uint64_t{0};
/// A section is read and checked in pieces of so many bytes: no more memory is taken than bytes have come.
constexpr uint64_t kPieceBytes = 8 << 20;

/// A type of section that readers know, and the most bytes that a section of it may have.
struct KnownSection {
  SectionType type;
  bool catalog;
  uint64_t most;
};
constexpr uint64_t kGiB = uint64_t{1} << 30;
constexpr KnownSection kKnown[] = {
    {SectionType::kMeta, true, 192},
    {SectionType::kTopTree, true, kGiB / 4},
    {SectionType::kDirectory, true, kGiB},
    {SectionType::kMaterials, true, 16 << 20},
    {SectionType::kTextureDirectory, true, kGiB},
    {SectionType::kMaterialTextures, true, 32 << 20},
    {SectionType::kEmitters, true, kMostEmitters* kEmitterBytes},
    {SectionType::kMappedEmitters, true, kMostEmitters* kMappedEmitterBytes},
    {SectionType::kEnvironment, true, kMostSkyTableBytes},
    {SectionType::kParts, false, kGiB / 4},
    {SectionType::kStrings, false, 4 * kGiB},
    {SectionType::kCameras, false, 1 << 20},
    {SectionType::kLights, false, 1 << 20},
    {SectionType::kPartTree, false, kGiB / 4 / sizeof(uint32_t) * kScenePartBytes},
    {SectionType::kVoxelParts, false, 4 * kGiB},
    {SectionType::kPartAttributes, false, 4 * kGiB},
    {SectionType::kModels, false, sizeof(uint32_t) + kMostModelNames*(kMostModelNameBytes + 1)},
    {SectionType::kBlocks, false, kUnlimited},
    {SectionType::kProxies, false, kUnlimited},
    {SectionType::kTexturePages, false, kUnlimited},
};

const KnownSection* Known(SectionType type) {
  for (const KnownSection& known : kKnown)
    if (known.type == type) return &known;
  return nullptr;
}

/// Whether a whole piece is zeros. A sparse file costs its maker nothing, and its reader memory; no section
/// of entries has so many zeros in a row.
bool IsHole(std::span<const std::byte> piece) {
  return piece.size() == kPieceBytes &&
         std::ranges::all_of(piece, [](std::byte b) { return b == std::byte{0}; });
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

/// The error for a damaged section of the file at `path`.
tl::unexpected<Error> Damaged(const std::string& path, const SectionEntry& entry, const char* how) {
  return FailForGood(fmt::format("{}: section {} at byte {} is damaged ({}); make the store again", path,
                                 TypeName(entry.type), entry.offset, how));
}

Result<ModelNames> DecodeModels(const std::string& path, const SectionEntry& entry,
                                std::span<const std::byte> bytes) {
  ModelNames models;
  ByteReader in(bytes);
  models.count = in.Get<uint32_t>();
  std::string_view text = AsText(bytes.subspan(std::min(bytes.size(), sizeof(uint32_t))));
  for (size_t end = 0; (end = text.find('\0')) != std::string_view::npos; text.remove_prefix(end + 1))
    models.names.emplace_back(text.substr(0, end));
  if (!in.ok() || !text.empty() || models.names.size() != std::min<size_t>(models.count, kMostModelNames))
    return Damaged(path, entry, "another number of names than it states");
  return models;
}

}  // namespace

Status CheckIsScene(const StoreReader& store) {
  if (!store.catalog().sky) return {};
  return BadUsage(
      fmt::format("{}: is an environment, which --environment names beside a scene", store.path()));
}

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
    return FailForGood(WrongSizeText(path(), file_->size(), header.file_size));
  id_ = header.id;
  Bytes table(header.table_bytes());
  QUARRY_TRY(file_->ReadAt(kStoreHeaderBytes, table));
  QUARRY_TRY(CheckStoreTable(header, table, path()));
  return ReadSections(table, header.sections);
}

/// Reads a section and checks it.
Result<Bytes> StoreReader::ReadBytes(const SectionEntry& entry) const {
  Bytes bytes;
  bytes.reserve(entry.size);
  while (bytes.size() < entry.size) {
    const uint64_t at = bytes.size(), piece = std::min(kPieceBytes, entry.size - at);
    bytes.resize(at + piece);
    const auto read = std::span(bytes).subspan(at);
    QUARRY_TRY(file_->ReadAt(entry.offset + at, read));
    if (IsHole(read)) return Damaged(path(), entry, "zeros where entries should be");
  }
  if (Checksum(bytes) != entry.checksum) return Damaged(path(), entry, "checksum");
  return bytes;
}

/// Checks a section that does not stay in memory.
Status StoreReader::CheckBytes(const SectionEntry& entry) const {
  const bool entries = entry.type == SectionType::kParts || entry.type == SectionType::kPartTree ||
                       entry.type == SectionType::kVoxelParts || entry.type == SectionType::kPartAttributes;
  RunningChecksum checksum;
  Bytes piece;
  for (uint64_t at = 0; at < entry.size; at += piece.size()) {
    piece.resize(std::min(kPieceBytes, entry.size - at));
    QUARRY_TRY(file_->ReadAt(entry.offset + at, piece));
    if (entries && IsHole(piece)) return Damaged(path(), entry, "zeros where entries should be");
    checksum.Add(piece);
  }
  if (checksum.value() != entry.checksum) return Damaged(path(), entry, "checksum");
  return {};
}

/// Reads a section of the catalog, or of `views`; checks any other that readers use.
Status StoreReader::ReadSection(const SectionEntry& entry, std::vector<Section>& views) {
  const KnownSection* const known = Known(entry.type);
  if (!known || (entry.flags & kSectionOwnChecksums)) return {};
  const bool views_too = entry.type == SectionType::kCameras || entry.type == SectionType::kLights;
  const bool models = entry.type == SectionType::kModels;
  if (!known->catalog && !views_too && !models) return CheckBytes(entry);
  QUARRY_ASSIGN(Bytes bytes, ReadBytes(entry));
  if (models) {
    QUARRY_ASSIGN(models_, DecodeModels(path(), entry, bytes));
    return {};
  }
  (known->catalog ? catalog_sections_ : views).push_back({entry.type, std::move(bytes)});
  return {};
}

/// Checks the entries of the section table. Sections follow each other without gaps, so that none overlap.
Result<std::vector<SectionEntry>> StoreReader::ReadTable(std::span<const std::byte> table,
                                                         uint32_t count) const {
  std::vector<SectionEntry> entries;
  ByteReader in(table);
  uint64_t end = kStoreHeaderBytes + table.size();
  for (uint32_t i = 0; i < count; ++i) {
    SectionEntry e;
    e.type = static_cast<SectionType>(in.Get<uint32_t>());
    e.flags = in.Get<uint32_t>();
    e.offset = in.Get<uint64_t>();
    e.size = in.Get<uint64_t>();
    e.checksum = in.Get<uint64_t>();
    in.Get<uint64_t>();  // reserved
    const KnownSection* const known = Known(e.type);
    if (e.offset != end || e.size > file_->size() - e.offset)
      return FailForGood(fmt::format("{}: section {} is not where it should be", path(), TypeName(e.type)));
    end = e.offset + e.size;
    if (!known && (e.flags & kSectionCritical))
      return FailForGood(fmt::format("{}: needs a newer program: section {} is unknown to this one", path(),
                                     TypeName(e.type)));
    if (known && e.size > known->most)
      return FailForGood(
          fmt::format("{}: section {} claims {} bytes, more than the {} that it may have; make the "
                      "store again",
                      path(), TypeName(e.type), e.size, known->most));
    if (known && std::ranges::find(entries, e.type, &SectionEntry::type) != entries.end())
      return FailForGood(
          fmt::format("{}: has two sections {}; make the store again", path(), TypeName(e.type)));
    entries.push_back(e);
  }
  if (end != file_->size())
    return FailForGood(fmt::format("{}: {} bytes after the last section", path(), file_->size() - end));
  return entries;
}

Status StoreReader::ReadSections(std::span<const std::byte> table, uint32_t count) {
  QUARRY_ASSIGN(const std::vector<SectionEntry> entries, ReadTable(table, count));
  std::vector<Section> views;
  StoreNames::Place parts, strings;
  PartSections::Places of_parts;
  for (const SectionEntry& e : entries) {
    QUARRY_TRY(ReadSection(e, views));
    if (e.type == SectionType::kParts) parts = {e.offset, e.size};
    if (e.type == SectionType::kStrings) strings = {e.offset, e.size};
    if (e.type == SectionType::kPartTree) {
      of_parts.tree = {e.offset, e.size};
      of_parts.has_tree = true;
    }
    if (e.type == SectionType::kVoxelParts) {
      of_parts.lists = {e.offset, e.size};
      of_parts.has_lists = true;
    }
    if (e.type == SectionType::kPartAttributes) of_parts.attributes = {e.offset, e.size};
    if (e.type == SectionType::kBlocks) {
      blocks_begin_ = e.offset;
      blocks_end_ = e.offset + e.size;
    } else if (e.type == SectionType::kTexturePages) {
      pages_begin_ = e.offset;
      pages_end_ = e.offset + e.size;
    }
  }
  names_ = std::make_unique<StoreNames>(*file_, parts, strings);
  part_sections_ = std::make_unique<PartSections>(*file_, *names_, of_parts);
  auto catalog = DecodeCatalog(id_, catalog_sections_, {pages_begin_, pages_end_});
  if (!catalog) return FailForGood(fmt::format("{}: {}", path(), catalog.error().message));
  catalog_ = std::move(*catalog);
  for (uint32_t m = 0; m < catalog_.materials.size(); ++m)
    for (const TextureBinding& binding : catalog_.materials[m].textures)
      material_textures_.push_back({m, binding});
  const Status decoded = DecodeViews(views);
  if (!decoded) return FailForGood(fmt::format("{}: {}", path(), decoded.error().message));
  return {};
}

Status StoreReader::DecodeViews(const std::vector<Section>& sections) {
  size_t names = 0;
  const NameLookup name_at = [&](uint32_t offset) -> Result<std::string> {
    QUARRY_ASSIGN(std::string name, names_->At(offset));
    names += name.size();
    if (names > kMostViewNameBytes)
      return Fail(
          fmt::format("the names of its cameras and lights take more than {} bytes", kMostViewNameBytes));
    return name;
  };
  for (const Section& s : sections) {
    if (s.type == SectionType::kCameras) {
      QUARRY_ASSIGN(views_.cameras, DecodeCameras(s.bytes, name_at));
    } else if (s.type == SectionType::kLights) {
      QUARRY_ASSIGN(views_.lights, DecodeLights(s.bytes, name_at));
    }
  }
  return {};
}

/// The name whose offset in STRS stands at byte `at` of a section of the catalog.
Result<std::string> StoreReader::NameIn(SectionType section, uint64_t at) const {
  for (const Section& s : catalog_sections_) {
    if (s.type != section) continue;
    ByteReader in(s.bytes);
    in.GetSpan(at);
    const auto offset = in.Get<uint32_t>();
    return in.ok() ? names_->At(offset) : std::string();
  }
  return std::string();
}

Result<std::string> StoreReader::MaterialName(uint32_t material) const {
  if (material >= catalog_.materials.size()) return std::string();
  return NameIn(SectionType::kMaterials, sizeof(uint32_t) + kMaterialBytes * material);
}

Result<std::string> StoreReader::TextureName(uint32_t texture) const {
  if (texture >= textures().size()) return std::string();
  return NameIn(SectionType::kTextureDirectory, sizeof(uint32_t) + kTextureBytes * texture);
}

Status StoreReader::ForEachVoxelParts(
    const std::function<void(uint32_t voxel, std::span<const uint32_t> parts)>& each) const {
  PartListReader lists = part_sections_->Lists();
  for (uint32_t voxel = 0; voxel < catalog_.voxels.size(); ++voxel) {
    QUARRY_ASSIGN(const std::span<const uint32_t> parts, lists.Next(catalog_.voxels[voxel].triangles));
    each(voxel, parts);
  }
  return lists.CheckEnd();
}

Result<Bytes> StoreReader::ReadBlock(BlockKey block) const {
  if (!catalog_.Has(block))
    return FailForGood(fmt::format("{}: there is no block {}", path(), catalog_.NumberOf(block)));
  const BlockEntry& entry = catalog_.block(block);
  const bool page = block.kind() == BlockKind::kPage;
  const uint64_t begin = page ? pages_begin_ : blocks_begin_, end = page ? pages_end_ : blocks_end_;
  if (entry.offset < begin || entry.offset > end || entry.stored > end - entry.offset)
    return FailForGood(
        fmt::format("{}: block {} is not where it should be", path(), catalog_.NumberOf(block)));
  Bytes bytes(entry.stored);
  QUARRY_TRY(file_->ReadAt(entry.offset, bytes));
  if (Checksum(bytes) != entry.checksum)
    return FailForGood(fmt::format("{}: block {} at byte {} is damaged (checksum); make the store again",
                                   path(), catalog_.NumberOf(block), entry.offset));
  return bytes;
}

Result<Bytes> StoreReader::ReadPage(uint32_t texture, uint32_t page) const {
  if (texture >= textures().size() || page >= textures()[texture].pages.size())
    return FailForGood(fmt::format("{}: there is no page {} of texture {}", path(), page, texture));
  const auto damaged = [&](const std::string& how) {
    return FailForGood(fmt::format("{}: page {} of texture {} ({}) at byte {}: {}; make the store again",
                                   path(), page, texture, TextureName(texture).value_or(""),
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

Status StoreReader::Verify(const std::function<void(uint64_t done, uint64_t total)>& progress) const {
  StoreVerifier verifier(*this);
  QUARRY_TRY(verifier.CheckPartTree());
  const uint64_t voxels = catalog_.voxels.size(), all = voxels + textures().size();
  for (uint32_t v = 0; v < voxels; ++v) {
    QUARRY_TRY(verifier.CheckVoxel(v));
    progress(v + 1, all);
  }
  QUARRY_TRY(verifier.CheckVoxelsEnd());
  for (uint32_t t = 0; t < textures().size(); ++t) {
    QUARRY_TRY(verifier.CheckTexture(t));
    progress(voxels + t + 1, all);
  }
  return verifier.CheckPagesFill();
}

}  // namespace quarry
