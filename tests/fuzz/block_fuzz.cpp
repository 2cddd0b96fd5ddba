// Decodes the bytes as a block, as if their checksum were right: two bytes of decoded size (in units of 16),
// one of kind and rest of the size, then the stored bytes. Or as a page of a texture: its sides less 1, kind
// with channels and format, then the stored bytes.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "common/kdtree/opacity_mask.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/texture_page.h"

namespace {

void DecodeAsPages(const uint8_t* head, std::span<const std::byte> stored) {
  const quarry::TexelLayout layout{
      head[0] + 1u, head[1] + 1u, 1u + (head[2] & 3u),
      static_cast<quarry::TexelFormat>((head[2] >> 2 & 3u) % quarry::kTexelFormats)};
  const quarry::TextureShape shape(layout.width, layout.height);
  for (const uint32_t page : {0u, shape.pages() - 1}) {
    const auto texels = quarry::DecodePage(shape, layout, page, stored);
    if (texels && texels->size() != shape.TexelsOf(page) * layout.texel_bytes()) std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < 3) return 0;
  const size_t decoded = (size_t{data[0]} | size_t{data[1]} << 8) * 16 + (data[2] & 15);
  const auto stored = std::as_bytes(std::span(data + 3, size - 3));
  if ((data[2] & 32) != 0) {
    DecodeAsPages(data, stored);
    return 0;
  }
  // Just as large as it says, so that the sanitizer sees a byte too many.
  void* memory = std::aligned_alloc(16, (decoded + 15) / 16 * 16 + 16);
  const std::span<std::byte> out(static_cast<std::byte*>(memory), decoded);
  static quarry::BlockDecoder decoder;
  static std::vector<quarry::KdNode> tree;
  if ((data[2] & 16) != 0) {
    (void)decoder.Shading(stored, out);
  } else if (const auto view = decoder.Hot(stored, out, 1e-6f, (data[2] & 64) != 0 ? &tree : nullptr)) {
    // Kernels rely on these bounds.
    for (uint32_t r = 0; r < view->reference_count; ++r)
      if (view->references[r] >= view->triangle_count) std::abort();
    for (uint32_t c = 0; c < 3 * view->triangle_count; ++c)
      if (view->corners[c] >= view->vertex_count) std::abort();
    for (uint32_t t = 0; view->masks != nullptr && t < view->triangle_count; ++t)
      if (!quarry::IsMask(view->masks[t], view->fine_mask_count)) std::abort();
    for (uint32_t f = 0; f < view->fine_mask_count; ++f)
      if (!std::ranges::all_of(view->fine_masks[f].words, quarry::HoldsStates)) std::abort();
  }
  std::free(memory);
  return 0;
}
