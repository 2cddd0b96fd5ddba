#include "preprocess/import/importer.h"

#include <fmt/format.h>
#include <sys/mman.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <system_error>

#include "preprocess/import/cad/cad_importer.h"
#include "preprocess/import/foreign/foreign_content.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/origin_survey.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

/// A reader of a format.
using Import = std::function<Result<uint64_t>(ModelReader&, ModelSink&)>;

enum class Format { kNone, kPly, kObj, kStl, kOff, kNff, kGltf, kThreeMf };

Import ImportOf(Format format, const GltfDecoding& decoding) {
  switch (format) {
    case Format::kPly:
      return ImportPly;
    case Format::kObj:
      return ImportObj;
    case Format::kStl:
      return ImportStl;
    case Format::kOff:
      return ImportOff;
    case Format::kNff:
      return ImportNff;
    case Format::kGltf:
      return [&decoding](ModelReader& bytes, ModelSink& sink) { return ImportGltf(bytes, sink, decoding); };
    case Format::kThreeMf:
      return ImportThreeMf;
    case Format::kNone:
      break;
  }
  return {};
}

/// The reader of STEP or IGES.
Import CadImportOf(CadFormat format, const CadReading& cad) {
  return [format, &cad](ModelReader& bytes, ModelSink& sink) { return ImportCad(bytes, format, cad, sink); };
}

bool LooksLikePly(ModelReader& bytes) {
  return bytes.Ensure(4) && bytes.view().starts_with("ply") && IsSpace(bytes.data()[3]);
}

/// Chooses a reader by content first, since extensions are often wrong, then by the extension, whose reader
/// reports errors. kNone: neither decides.
Format ChooseFormat(ModelReader& bytes, std::filesystem::path path) {
  if (bytes.is_packed()) path = path.stem();  // "model.obj.gz"
  if (LooksLikePly(bytes)) return Format::kPly;
  if (LooksLikeGltf(bytes)) return Format::kGltf;
  if (LooksLikeThreeMf(bytes)) return Format::kThreeMf;
  if (LooksLikeOff(bytes)) return Format::kOff;
  if (LooksLikeNff(bytes)) return Format::kNff;
  if (LooksLikeStl(bytes)) return Format::kStl;
  const std::string extension = path.extension().string();
  if (EqualsIgnoringCase(extension, ".obj")) return Format::kObj;
  if (EqualsIgnoringCase(extension, ".off")) return Format::kOff;
  if (EqualsIgnoringCase(extension, ".nff") || EqualsIgnoringCase(extension, ".aff")) return Format::kNff;
  if (EqualsIgnoringCase(extension, ".gltf") || EqualsIgnoringCase(extension, ".glb")) return Format::kGltf;
  if (EqualsIgnoringCase(extension, ".3mf")) return Format::kThreeMf;
  if (EqualsIgnoringCase(extension, ".stl")) return LooksLikeObj(bytes) ? Format::kObj : Format::kStl;
  if (EqualsIgnoringCase(extension, ".ply")) return LooksLikeObj(bytes) ? Format::kObj : Format::kPly;
  return LooksLikeObj(bytes) ? Format::kObj : Format::kNone;
}

/// The kind of a foreign file by its first bytes and its name without ".gz".
ForeignContent ContentOf(ModelReader& bytes, std::filesystem::path path) {
  constexpr size_t kLook = 16 << 10;   // headers of STEP and IFC are long
  if (LooksLikeStl(bytes)) return {};  // its 80-byte header may hold anything
  if (LooksLikeThreeMf(bytes)) return {};
  if (LooksLikeOff(bytes)) return {};  // whose numbers look like a table
  if (!bytes.can_reopen() && bytes.view().starts_with("PK\3\4"))
    return {"a zip archive, as 3MF is, whose directory is at its end", "give it as a file, not by a pipe"};
  if (bytes.is_packed()) path = path.stem();
  bytes.Ensure(kLook);
  const ForeignContent content = RecognizeForeign(bytes.view().substr(0, kLook), path.extension().string());
  const bool has_vertices = content.what == kMaterialLibrary && LooksLikeObj(bytes);
  return has_vertices ? ForeignContent{} : content;
}

tl::unexpected<Error> IsForeign(const ModelReader& bytes, const ForeignContent& content) {
  return Fail(fmt::format("{}: is {}; {}", bytes.path(), content.what, content.advice));
}

/// Warns in advance if Assimp may need more memory than it may take.
void WarnOfMemory(const std::string& path, uint64_t memory, ModelSink& sink) {
  std::error_code none;
  const uintmax_t bytes = std::filesystem::file_size(path, none);
  if (none || bytes <= memory / kForeignBytesPerByte) return;
  sink.Warn(
      fmt::format("{}: is read by Assimp, which loads a model whole, in up to {} times its size of {} MiB; "
                  "it may take {} MiB",
                  path, kForeignBytesPerByte, (bytes * kForeignBytesPerByte) >> 20, memory >> 20));
}

/// Reads the model's beginning to find a point for the scene's offset.
void FindOrigin(const std::string& path, uint64_t unpack_limit, const Import& import, ModelSink& sink) {
  if (!sink.WantsOrigin()) return;
  Result<ModelReader> bytes = ModelReader::Open(path, unpack_limit);
  if (!bytes) return;
  OriginSurvey survey;
  (void)import(*bytes, survey);  // errors are reported when the model is read
  if (const auto place = survey.Place()) sink.SetOrigin(*place);
}

/// Does so for a pipe, from the bytes in the buffer: they become a file in memory that ends early.
void FindOriginOfPipe(ModelReader& bytes, const Import& import, ModelSink& sink) {
  if (!sink.WantsOrigin()) return;
  bytes.Ensure(ModelReader::kBufferBytes);
  const int fd = ::memfd_create("beginning", MFD_CLOEXEC);
  if (fd < 0) return;
  if (::write(fd, bytes.data(), bytes.available()) == static_cast<ssize_t>(bytes.available()))
    FindOrigin(fmt::format("/proc/self/fd/{}", fd), 0, import, sink);
  ::close(fd);
}

}  // namespace

tl::unexpected<Error> NoFaces(const std::string& path, uint64_t vertices) {
  return Fail(fmt::format(
      "{}: holds no triangles: {} vertices and no faces (a point cloud, or lines), which have no surface to "
      "trace; make a mesh of them first (MeshLab or CloudCompare, say)",
      path, vertices));
}

Status ImportModel(const std::string& path, ModelSink& sink, const ForeignFormats& foreign,
                   uint64_t unpack_limit, const GltfDecoding& decoding, const CadReading& cad) {
  QUARRY_ASSIGN(ModelReader bytes, ModelReader::Open(path, unpack_limit));
  if (!bytes.Ensure(1) && !bytes.failed()) return Fail(fmt::format("{}: is empty", bytes.path()));
  const ForeignContent content = ContentOf(bytes, path);
  const bool is_cad = content.cad != CadFormat::kNone && !cad.program.empty();
  if (!content.what.empty() && !content.may_be_read && !is_cad) return IsForeign(bytes, content);
  const Format format = content.what.empty() ? ChooseFormat(bytes, path) : Format::kNone;
  const Import import = is_cad ? CadImportOf(content.cad, cad) : ImportOf(format, decoding);
  if (bytes.failed()) return bytes.Truncated("");
  const std::string name = std::filesystem::path(bytes.path()).filename().string();
  const bool by_assimp = !foreign.program.empty() && bytes.can_reopen() && !bytes.is_packed();
  if (import == nullptr && !by_assimp && !content.what.empty()) return IsForeign(bytes, content);
  if (import == nullptr && !by_assimp && !foreign.program.empty())
    return Fail(fmt::format(
        "{}: is neither PLY, OBJ, STL, OFF, NFF, AFF, glTF nor 3MF; other formats are read from files "
        "that are not packed: {}",
        bytes.path(), bytes.is_packed() ? "unpack it first" : "give it as a file"));
  if (import == nullptr && !by_assimp)
    return Fail(
        fmt::format("{}: is neither PLY, OBJ, STL, OFF, NFF, AFF, glTF nor 3MF, the formats that are read",
                    bytes.path()));
  QUARRY_TRY(sink.BeginFile(name));
  if (format == Format::kGltf || format == Format::kNff) sink.SetSmoothing(kFlat);  // as these formats state
  if (!is_cad) bytes.OnRead([&sink](uint64_t done, uint64_t total) { sink.HasRead(done, total); });
  if (import == nullptr) {
    WarnOfMemory(path, foreign.memory, sink);
    const Result<ForeignModel> converted = ForeignModel::Convert(path, foreign);
    if (!converted && !content.what.empty()) return IsForeign(bytes, content);
    if (!converted) return tl::unexpected(converted.error());
    QUARRY_ASSIGN(ModelReader ply, ModelReader::Open(converted->ply()));
    FindOrigin(converted->ply(), 0, ImportPly, sink);
    QUARRY_TRY(ImportConverted(ply, path, sink));
    return sink.EndFile();
  }
  // These readers know the structure before the first triangle, and give the origin themselves.
  const bool tells_origin = is_cad || format == Format::kThreeMf;
  if (!tells_origin && bytes.can_reopen()) FindOrigin(path, unpack_limit, import, sink);
  if (!tells_origin && !bytes.can_reopen()) FindOriginOfPipe(bytes, import, sink);
  QUARRY_ASSIGN(const uint64_t triangles, import(bytes, sink));
  if (triangles == 0) return Fail(fmt::format("{}: holds no triangles", bytes.path()));
  return sink.EndFile();
}

}  // namespace quarry
