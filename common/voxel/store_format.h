#pragma once

#include <cstdint>
#include <string_view>

namespace quarry {

/// The first eight bytes of every scene store; the line ending shows transfers that mangled it.
inline constexpr std::string_view kStoreMagic = "QUARRY\r\n";
/// Moves freely until the first release.
inline constexpr uint32_t kStoreVersion = 9;

inline constexpr uint64_t kStoreHeaderBytes = 64;
inline constexpr uint64_t kSectionEntryBytes = 40;
inline constexpr uint32_t kMaxSections = 64;

/// Section flags.
inline constexpr uint32_t kSectionCritical =
    1;  ///< a reader that does not know the type must refuse the store
inline constexpr uint32_t kSectionOwnChecksums =
    2;  ///< its parts are checksummed elsewhere (blocks: in VDIR)

}  // namespace quarry
