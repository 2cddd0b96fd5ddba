#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "common/base/status.h"
#include "preprocess/texture/image_protocol.h"

namespace quarry {

/// To be called first: sets OpenImageIO up, and loads what it loads at the first image.
void PrepareDecoding();

using OnFacts = std::function<void(const ImageFacts&)>;
using OnRows = std::function<void(std::span<const std::byte>)>;

/// Decodes one image, which is the `size` bytes from `offset` of the file, or fewer where that ends: its
/// facts, and unless `look_only` all of its rows, in messages of about 1 MB. Memory: a row of tiles, or what
/// its decoder takes. Errors: a sentence of why it cannot be read. Throws what decoders throw
/// (std::bad_alloc). Not thread-safe.
Status DecodeImage(const std::string& path, uint64_t offset, uint64_t size, bool look_only,
                   const OnFacts& on_facts, const OnRows& on_rows);

/// The first line of a library's sentence, of a length to be read.
std::string Refusal(const std::string& why);

}  // namespace quarry
