#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/voxel/catalog.h"

namespace quarry {

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

}  // namespace quarry
