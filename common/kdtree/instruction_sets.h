#pragma once

#include <span>
#include <string_view>

namespace quarry {

/// The instruction sets of Kernels(), each once; renders use the first. Empty as Kernels() is. Thread-safe.
std::span<const std::string_view> InstructionSets();

}  // namespace quarry
