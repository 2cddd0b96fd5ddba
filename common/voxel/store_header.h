#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// The first eight bytes of a store. The line ending reveals transfers that change line endings.
inline constexpr std::string_view kStoreMagic = "QUARRY\r\n";
/// Versions of the format: of stores with opacity masks; of others, whose shading blocks may have packed
/// normals; of all others. Stores of other versions are refused; they change freely until the first release.
inline constexpr uint32_t kStoreVersion = 12, kPackedStoreVersion = 10, kUnpackedStoreVersion = 9;

/// Sizes of the header and of an entry of the section table; limit of sections against damaged headers.
inline constexpr uint64_t kStoreHeaderBytes = 64;
inline constexpr uint64_t kSectionEntryBytes = 40;
inline constexpr uint32_t kMaxSections = 64;

/// Flags of sections.
inline constexpr uint32_t kSectionCritical =
    1;  ///< a reader that does not know the type must refuse the store
inline constexpr uint32_t kSectionOwnChecksums =
    2;  ///< the section's parts have checksums elsewhere (blocks: in VDIR)

/// The contents of the first 64 bytes of a store. FORMAT.md gives the layout.
struct StoreHeader {
  uint32_t sections = 0;
  uint64_t file_size = 0;  ///< bytes
  SceneId id{};
  uint64_t table_checksum = 0;

  /// Size of the section table.
  uint64_t table_bytes() const;
};

/// Decodes bytes 0 to 63 of a store. `name` (a path or URL) begins the message of an error.
/// Errors, all permanent: not a store; damaged; another format version (the message has both); an impossible
/// table.
Result<StoreHeader> DecodeStoreHeader(std::span<const std::byte> bytes, const std::string& name);

/// Checks the section table that follows the header. Errors, permanent: the checksum differs from the
/// header's.
Status CheckStoreTable(const StoreHeader& header, std::span<const std::byte> table, const std::string& name);

/// Checks that the store with this header and table has the blocks of `catalog` at the same offsets, so that
/// they can be fetched from it. One scene compressed twice has one id but two layouts.
/// Requires: the table passed CheckStoreTable().
/// Errors, permanent: another scene (the message has both ids); another layout.
Status CheckSameStore(const StoreHeader& header, std::span<const std::byte> table, const Catalog& catalog,
                      const std::string& name);

/// The sentence about a store's file with `bytes` bytes whose header states `expected`.
std::string WrongSizeText(const std::string& name, uint64_t bytes, uint64_t expected);

}  // namespace quarry
