#include "scenes/mesh_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <initializer_list>
#include <string_view>

#include "common/base/output_path.h"
#include "common/math/elementary.h"
#include "common/scene/material_json.h"
#include "scenes/obj_writer.h"
#include "scenes/ply_writer.h"

namespace quarry::scenes {
namespace {

enum class MeshFormat { kPly, kObj };

Result<MeshFormat> FormatOf(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  if (extension == ".ply") return MeshFormat::kPly;
  if (extension == ".obj") return MeshFormat::kObj;
  return BadUsage(fmt::format("{}: the name must end in .ply or .obj, which chooses the format.", path));
}

/// Whether the first line that is no comment begins with one of these words.
bool BeginsWithWord(std::string_view text, std::initializer_list<std::string_view> words) {
  while (!text.empty()) {
    std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    line.remove_prefix(std::min(line.size(), line.find_first_not_of(" \t\r")));
    if (line.empty() || line.starts_with('#')) continue;
    const std::string_view word = line.substr(0, line.find_first_of(" \t\r"));
    return std::ranges::find(words, word) != words.end();
  }
  return false;
}

bool IsPly(std::string_view start) { return start.starts_with("ply\n") || start.starts_with("ply\r"); }
bool IsObj(std::string_view start) {
  return BeginsWithWord(start, {"mtllib", "usemtl", "o", "g", "v", "vn", "vt", "s", "f"});
}
bool IsMtl(std::string_view start) { return BeginsWithWord(start, {"newmtl"}); }
bool IsLibrary(std::string_view start) { return start.starts_with("{\"materials\""); }
bool IsPath(std::string_view start) { return start.starts_with("{\"frames\""); }

const OutputKind kPlyOutput{"a PLY model", IsPly, false}, kObjOutput{"an OBJ model", IsObj, false},
    kMtlOutput{"an MTL library", IsMtl, false}, kLibraryOutput{"a library of materials", IsLibrary, false},
    kPathOutput{"a camera path", IsPath, false};

}  // namespace

uint8_t SrgbByte(uint8_t linear) {
  static const std::array<uint8_t, 256> kEncoded = [] {
    std::array<uint8_t, 256> encoded;
    for (int i = 0; i < 256; ++i) encoded[i] = static_cast<uint8_t>(EncodeSrgb(i / 255.0) * 255 + 0.5);
    return encoded;
  }();
  return kEncoded[linear];
}

Result<std::unique_ptr<MeshWriter>> OpenMeshWriter(const std::string& path,
                                                   const std::vector<Material>& materials, bool colors) {
  QUARRY_ASSIGN(const MeshFormat format, FormatOf(path));
  if (format == MeshFormat::kPly) return OpenPlyWriter(path, materials, colors);
  return OpenObjWriter(path, materials, colors);
}

Status CheckSceneOutputs(const std::string& path, bool force) {
  QUARRY_ASSIGN(const MeshFormat format, FormatOf(path));
  OutputGuard guard(force ? OutputGuard::Force::kYes : OutputGuard::Force::kNo);
  QUARRY_TRY(guard.Take(WithExtension(path, ".path.json"), kPathOutput).map([](auto&&) {}));
  if (format == MeshFormat::kPly) {
    QUARRY_TRY(guard.Take(MaterialJsonPath(path), kLibraryOutput).map([](auto&&) {}));
    return guard.Take(path, kPlyOutput).map([](auto&&) {});
  }
  QUARRY_TRY(guard.Take(WithExtension(path, ".mtl"), kMtlOutput).map([](auto&&) {}));
  return guard.Take(path, kObjOutput).map([](auto&&) {});
}

std::string WithExtension(const std::string& path, const std::string& extension) {
  return std::filesystem::path(path).replace_extension(extension);
}

}  // namespace quarry::scenes
