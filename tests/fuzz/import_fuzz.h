#pragma once

#include <cstddef>
#include <cstdint>

/// Imports `data` as a model file of whatever format it looks like; ends the program only where an importer
/// is wrong. The first byte chooses the extension. Build with -fsanitize=fuzzer to run it by itself.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
