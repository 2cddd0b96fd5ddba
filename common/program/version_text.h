#pragma once

#include <span>
#include <string>
#include <string_view>

namespace quarry {

/// The text that `--version` prints: the program with its release; the revision of its sources, where that
/// was known when the build was configured; compiler and kind of build; instruction sets; shared libraries
/// with the versions of the files that this process has loaded.
/// `instruction_sets`: of kernels, the one in use first; empty for a program without kernels.
std::string VersionText(const std::string& program, std::span<const std::string_view> instruction_sets = {});

}  // namespace quarry
