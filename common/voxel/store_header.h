#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// What the first 64 bytes of a store say; FORMAT.md has them.
struct StoreHeader {
  uint32_t sections = 0;
  uint64_t file_size = 0;  ///< bytes
  SceneId id{};
  uint64_t table_checksum = 0;

  uint64_t table_bytes() const;
};

/// Decodes bytes 0 to 63 of a store; `name` (a path, an address) begins the sentence of an error.
/// Errors, all permanent: not a store, damaged, another format version (both named), a table that cannot be.
Result<StoreHeader> DecodeStoreHeader(std::span<const std::byte> bytes, const std::string& name);

/// The section table that follows the header. Errors, permanent: its checksum is not the header's.
Status CheckStoreTable(const StoreHeader& header, std::span<const std::byte> table, const std::string& name);

/// Whether blocks of the store with this header and table lie where `catalog` says, so that they can be
/// fetched from it: the same scene, and its blocks from the same byte to the same byte. (One scene compressed
/// twice has one id and two layouts.) The table must have passed CheckStoreTable.
/// Errors, permanent: another scene (both ids named); another layout.
Status CheckSameStore(const StoreHeader& header, std::span<const std::byte> table, const Catalog& catalog,
                      const std::string& name);

}  // namespace quarry
