#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "preprocess/import/model_reader.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// A polygon of more corners than this is taken for a broken file.
inline constexpr uint64_t kMaxPolygonCorners = 65536;

/// Each reads one file, from its first byte, into `sink` between BeginFile and EndFile, which are the
/// caller's. Returns the number of triangles that the polygons given make. Errors: as ImportModel().
Result<uint64_t> ImportPly(ModelReader& bytes, ModelSink& sink);
Result<uint64_t> ImportObj(ModelReader& bytes, ModelSink& sink);
Result<uint64_t> ImportStl(ModelReader& bytes, ModelSink& sink);
Result<uint64_t> ImportOff(ModelReader& bytes, ModelSink& sink);
Result<uint64_t> ImportGltf(ModelReader& bytes, ModelSink& sink);
/// NFF and AFF.
Result<uint64_t> ImportNff(ModelReader& bytes, ModelSink& sink);

/// The error for a model of points only.
tl::unexpected<Error> NoFaces(const std::string& path, uint64_t vertices);

/// True if the bytes available look like an STL file, ASCII or binary, judging by content alone.
bool LooksLikeStl(ModelReader& bytes);
/// True if they begin as OFF, as a GLB or the JSON of a glTF, as NFF does.
bool LooksLikeOff(ModelReader& bytes);
bool LooksLikeNff(ModelReader& bytes);
bool LooksLikeGltf(ModelReader& bytes);
/// True if they look like the text of an OBJ file.
bool LooksLikeObj(ModelReader& bytes);

}  // namespace quarry
