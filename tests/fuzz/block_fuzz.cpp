// Decodes the bytes as a block, as if their checksum were right: two bytes of decoded size (in units of 16),
// one of kind and rest of it, then what is stored.
#include <cstdint>
#include <cstdlib>
#include <span>

#include "common/voxel/block_decoder.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < 3) return 0;
  const size_t decoded = (size_t{data[0]} | size_t{data[1]} << 8) * 16 + (data[2] & 15);
  const auto stored = std::as_bytes(std::span(data + 3, size - 3));
  // Just as large as it says, so that the sanitizer sees a byte too many.
  void* memory = std::aligned_alloc(16, (decoded + 15) / 16 * 16 + 16);
  const std::span<std::byte> out(static_cast<std::byte*>(memory), decoded);
  static quarry::BlockDecoder decoder;
  if ((data[2] & 16) != 0) {
    (void)decoder.Shading(stored, out);
  } else if (const auto view = decoder.Hot(stored, out, 1e-6f)) {
    // What kernels rely on.
    for (uint32_t r = 0; r < view->reference_count; ++r)
      if (view->references[r] >= view->triangle_count) std::abort();
    for (uint32_t c = 0; c < 3 * view->triangle_count; ++c)
      if (view->corners[c] >= view->vertex_count) std::abort();
  }
  std::free(memory);
  return 0;
}
