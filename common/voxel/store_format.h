#pragma once

#include <cstdint>
#include <string_view>

namespace quarry {

/// The first eight bytes of a store. The line ending reveals transfers that change line endings.
inline constexpr std::string_view kStoreMagic = "QUARRY\r\n";
/// Versions of the format: of stores with opacity masks; of others, whose shading blocks may have packed
/// normals; of all others. Stores of other versions are refused; they change freely until the first release.
inline constexpr uint32_t kStoreVersion = 11, kPackedStoreVersion = 10, kUnpackedStoreVersion = 9;

/// Sizes of the header and of an entry of the section table; limit of sections against damaged headers.
inline constexpr uint64_t kStoreHeaderBytes = 64;
inline constexpr uint64_t kSectionEntryBytes = 40;
inline constexpr uint32_t kMaxSections = 64;

/// Flags of sections.
inline constexpr uint32_t kSectionCritical =
    1;  ///< a reader that does not know the type must refuse the store
inline constexpr uint32_t kSectionOwnChecksums =
    2;  ///< the section's parts have checksums elsewhere (blocks: in VDIR)

}  // namespace quarry
