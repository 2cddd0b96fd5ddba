#include "preprocess/import/importer.h"

#include <fmt/format.h>

#include <filesystem>

#include "preprocess/import/formats.h"
#include "preprocess/import/text_number.h"

namespace quarry {
namespace {

using Import = Result<uint64_t> (*)(ByteReader&, ModelSink&);

bool LooksLikePly(ByteReader& bytes) {
  return bytes.Ensure(4) && bytes.view().starts_with("ply") && IsSpace(bytes.data()[3]);
}

/// By content first: extensions are often wrong. What is no text of a known kind goes by its extension, whose
/// reader then says what is wrong with it. Null if neither tells.
Import ChooseFormat(ByteReader& bytes, const std::filesystem::path& path) {
  if (LooksLikePly(bytes)) return ImportPly;
  if (LooksLikeStl(bytes)) return ImportStl;
  const std::string extension = path.extension().string();
  if (EqualsIgnoringCase(extension, ".obj")) return ImportObj;
  if (EqualsIgnoringCase(extension, ".stl")) return LooksLikeObj(bytes) ? ImportObj : ImportStl;
  if (EqualsIgnoringCase(extension, ".ply")) return LooksLikeObj(bytes) ? ImportObj : ImportPly;
  return LooksLikeObj(bytes) ? ImportObj : nullptr;
}

}  // namespace

Status ImportModel(const std::string& path, ModelSink& sink) {
  QUARRY_ASSIGN(ByteReader bytes, ByteReader::Open(path));
  if (bytes.size() == 0) return Fail(fmt::format("{}: is empty", path));
  const Import import = ChooseFormat(bytes, path);
  if (bytes.read_error() != 0) return bytes.Truncated("");
  if (import == nullptr)
    return Fail(fmt::format("{}: is neither PLY nor OBJ nor STL, the formats that are read", path));
  QUARRY_TRY(sink.BeginFile(std::filesystem::path(path).filename().string()));
  QUARRY_ASSIGN(const uint64_t triangles, import(bytes, sink));
  if (triangles == 0) return Fail(fmt::format("{}: holds no triangles", path));
  return sink.EndFile();
}

}  // namespace quarry
