#include "common/program/version_text.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <link.h>

#include <algorithm>
#include <boost/version.hpp>
#include <filesystem>
#include <system_error>
#include <vector>

#include "common/base/version.h"

namespace quarry {
namespace {

// Libraries that every C++ program loads; they say nothing about Quarry.
constexpr std::string_view kOfEveryProgram[] = {"libc", "libm", "libgcc_s", "linux-vdso", "ld-linux-x86-64"};

/// "liblz4 1.9.4" for /usr/lib/liblz4.so.1, whose file is liblz4.so.1.9.4; empty: not worth telling.
std::string LibraryText(const char* path) {
  std::error_code error;
  const std::string file = std::filesystem::canonical(path, error).filename().string();
  const size_t end = file.find(".so");
  if (error || end == std::string::npos) return "";
  const std::string name = file.substr(0, end);
  if (std::ranges::find(kOfEveryProgram, name) != std::end(kOfEveryProgram)) return "";
  return end + 4 < file.size() ? fmt::format("{} {}", name, file.substr(end + 4)) : name;
}

int AddLibrary(dl_phdr_info* info, size_t, void* list) {
  if (std::string text = info->dlpi_name ? LibraryText(info->dlpi_name) : ""; !text.empty())
    static_cast<std::vector<std::string>*>(list)->push_back(std::move(text));
  return 0;
}

/// OpenSSL's own words, for the name of its file holds "3" only. Empty: this program does not link it.
std::string OpenSslText() {
  using Version = const char* (*)(int);
  const auto version = reinterpret_cast<Version>(::dlsym(RTLD_DEFAULT, "OpenSSL_version"));
  return version ? version(0) : "";
}

std::vector<std::string> Libraries() {
  std::vector<std::string> libraries;
  ::dl_iterate_phdr(AddLibrary, &libraries);
  std::ranges::sort(libraries);
  libraries.insert(libraries.begin(), fmt::format("Boost {}.{}.{} (headers)", BOOST_VERSION / 100000,
                                                  BOOST_VERSION / 100 % 1000, BOOST_VERSION % 100));
  if (std::string text = OpenSslText(); !text.empty()) {
    std::erase_if(libraries,
                  [](const std::string& l) { return l.starts_with("libssl") || l.starts_with("libcrypto"); });
    libraries.push_back(std::move(text));
  }
  return libraries;
}

std::string InstructionSetText(std::span<const std::string_view> sets) {
  if (sets.empty()) return "";
  const auto others = sets.subspan(1);
  return fmt::format("instruction set: {}{}\n", sets.front(),
                     others.empty() ? "" : fmt::format(" (also {})", fmt::join(others, ", ")));
}

}  // namespace

std::string VersionText(const std::string& program, std::span<const std::string_view> instruction_sets) {
  constexpr std::string_view kRevision = QUARRY_REVISION;
  return fmt::format("{} {}\n{}build: {}, {}, x86-64-v3 (AVX2, FMA)\n{}libraries: {}", program, kVersion,
                     kRevision.empty() ? "" : fmt::format("revision: {}\n", kRevision), QUARRY_COMPILER,
                     QUARRY_BUILD_TYPE, InstructionSetText(instruction_sets), fmt::join(Libraries(), ", "));
}

}  // namespace quarry
