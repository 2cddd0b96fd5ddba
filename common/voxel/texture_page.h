#pragma once

#include <span>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/texture_shape.h"

namespace quarry {

/// Encodes a page as streams, before LZ4: per channel, each value minus the prediction from its neighbours.
/// The same texels give the same bytes. Thread-safe.
/// Shapes: `texels` holds TexelsOf(page) texels of texel_bytes() each, row by row, channels interleaved,
/// halves low byte first. The result has the same number of bytes.
/// Source: the predictor is Paeth's (PNG, 1996).
Bytes EncodePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                 std::span<const std::byte> texels);

/// Decodes a stored page (CompressBlock of EncodePage). `texels`: row by row; for the tail's page level by
/// level. Thread-safe.
/// Requires: `texels` holds TexelsOf(page) texels.
/// Errors: LZ4 yields another number of bytes than the page has. Any bytes may be given.
Status DecodePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                  std::span<const std::byte> stored, std::span<std::byte> texels);
/// The same into new memory.
Result<Bytes> DecodePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                         std::span<const std::byte> stored);

}  // namespace quarry
