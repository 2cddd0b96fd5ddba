#include "common/voxel/store_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "common/base/size.h"

namespace quarry {
namespace {

template <class... Parts>
tl::unexpected<Error> Refuse(fmt::format_string<Parts...> format, Parts&&... parts) {
  return tl::unexpected<Error>(
      Error{fmt::format(format, std::forward<Parts>(parts)...), ErrorKind::kPermanent});
}

/// The range of bytes of the file that holds the blocks of `catalog`, which are contiguous.
struct Extent {
  uint64_t begin = 0, end = 0;
};
Extent BlocksOf(const Catalog& catalog) {
  Extent extent{~uint64_t{0}, 0};
  for (const VoxelEntry& v : catalog.voxels) {
    for (const BlockEntry& b : v.blocks) {
      if (b.stored == 0) continue;
      extent.begin = std::min(extent.begin, b.offset);
      extent.end = std::max(extent.end, b.offset + b.stored);
    }
  }
  return extent;
}

}  // namespace

uint64_t StoreHeader::table_bytes() const { return sections * kSectionEntryBytes; }

Result<StoreHeader> DecodeStoreHeader(std::span<const std::byte> bytes, const std::string& name) {
  if (AsText(bytes).substr(0, kStoreMagic.size()) != kStoreMagic)
    return Refuse("{}: not a Quarry scene store; quarry-preprocess makes one from a model", name);
  if (bytes.size() < kStoreHeaderBytes) return Refuse("{}: not a Quarry scene store (too short)", name);
  ByteReader in(bytes.first(kStoreHeaderBytes).subspan(kStoreMagic.size()));
  StoreHeader header;
  const auto version = in.Get<uint32_t>();
  header.sections = in.Get<uint32_t>();
  header.file_size = in.Get<uint64_t>();
  const auto table_offset = in.Get<uint64_t>();
  std::memcpy(header.id.data(), in.GetSpan(header.id.size()).data(), header.id.size());
  header.table_checksum = in.Get<uint64_t>();
  const auto header_checksum = in.Get<uint64_t>();
  if (Checksum(bytes.first(kStoreHeaderBytes - sizeof header_checksum)) != header_checksum)
    return Refuse("{}: the header is damaged (checksum); make the store again", name);
  if (version < kUnpackedStoreVersion || version > kStoreVersion)
    return Refuse(
        "{}: store format version {}, this program reads version {}; make the store again with this "
        "quarry-preprocess",
        name, version, kStoreVersion);
  if (header.sections > kMaxSections || table_offset != kStoreHeaderBytes ||
      table_offset + header.table_bytes() > header.file_size)
    return Refuse("{}: the header's section table is invalid", name);
  return header;
}

Status CheckStoreTable(const StoreHeader& header, std::span<const std::byte> table, const std::string& name) {
  if (table.size() != header.table_bytes() || Checksum(table) != header.table_checksum)
    return Refuse("{}: the section table is damaged (checksum); make the store again", name);
  return {};
}

Status CheckSameStore(const StoreHeader& header, std::span<const std::byte> table, const Catalog& catalog,
                      const std::string& name) {
  if (header.id != catalog.id)
    return Refuse("{}: serves another scene, {}, than the one rendered, {}; put the right store there", name,
                  FormatSceneId(header.id), FormatSceneId(catalog.id));
  const Extent wanted = BlocksOf(catalog);
  ByteReader in(table);
  bool there = wanted.end == 0;
  for (uint32_t i = 0; i < header.sections; ++i) {
    const auto type = static_cast<SectionType>(in.Get<uint32_t>());
    in.Get<uint32_t>();  // flags
    const auto offset = in.Get<uint64_t>();
    const auto size = in.Get<uint64_t>();
    in.GetSpan(16);  // checksum, reserved
    if (type == SectionType::kBlocks && in.ok())
      there = there || (offset == wanted.begin && size == wanted.end - wanted.begin);
  }
  if (!there)
    return Refuse(
        "{}: serves the same scene compressed in another way, so that its blocks lie elsewhere; put the "
        "rendered store itself there",
        name);
  return {};
}

std::string WrongSizeText(const std::string& name, uint64_t bytes, uint64_t expected) {
  if (bytes > expected)
    return fmt::format("{}: has {} bytes behind the end of its store; fetch or make it again", name,
                       bytes - expected);
  const std::string here = FormatSize(bytes), whole = FormatSize(expected);
  return here == whole
             ? fmt::format("{}: incomplete: {} of {} bytes; fetch or make it again", name, bytes, expected)
             : fmt::format("{}: incomplete: {} of {}; fetch or make it again", name, here, whole);
}

}  // namespace quarry
