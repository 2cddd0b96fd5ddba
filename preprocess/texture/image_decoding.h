#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "common/base/status.h"
#include "preprocess/texture/image_protocol.h"

namespace quarry {

/// Sets OpenImageIO up and loads its libraries. Required before DecodeImage().
void PrepareDecoding();

using OnFacts = std::function<void(const ImageFacts&)>;
using OnRows = std::function<void(std::span<const std::byte>)>;

/// Decodes an image: the `size` bytes from `offset` of the file, or fewer if the file ends. Sends its facts
/// and, unless `look_only`, all rows in messages of about 1 MB. Memory: a row of tiles, or whatever the
/// decoder takes.
/// Returns: a sentence about the fault of an image that the decoder reads nevertheless, such as an early end.
/// Empty: no fault.
/// Errors: a sentence why the image cannot be read. Throws the decoders' exceptions (std::bad_alloc). Thread
/// safety: none.
Result<std::string> DecodeImage(const std::string& path, uint64_t offset, uint64_t size, bool look_only,
                                const OnFacts& on_facts, const OnRows& on_rows);

/// The first line of a library's sentence, shortened.
std::string Refusal(const std::string& why);

}  // namespace quarry
