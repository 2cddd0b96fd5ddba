#pragma once

#include <span>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/texture_shape.h"

namespace quarry {

/// The streams of a page, before LZ4: for each channel the differences from what its neighbours foretell.
/// Requires: `texels` has as many as the page, texel_bytes() each: row by row, channels together, halves as
/// two bytes, lower first. The same texels give the same bytes, as many as there were. Thread-safe. Source:
/// the predictor is Paeth's (PNG, 1996).
Bytes EncodePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                 std::span<const std::byte> texels);

/// The texels of a stored page (CompressBlock over EncodePage): row by row, of the tail's page level by
/// level. Errors: LZ4 finds other than the bytes that the page has. Any bytes may be given. Thread-safe.
Result<Bytes> DecodePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                         std::span<const std::byte> stored);

}  // namespace quarry
