#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "preprocess/import/gltf/gltf_decoding.h"
#include "preprocess/import/model_reader.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// A polygon with more corners counts as a broken file.
inline constexpr uint64_t kMaxPolygonCorners = 65536;

/// Each reads one file from its first byte into `sink`; BeginFile() and EndFile() are the caller's. Returns
/// the number of triangles in the polygons given. Errors: as ImportModel().
Result<uint64_t> ImportPly(ModelReader& bytes, ModelSink& sink);
/// PLY that another program made of `model`, whose folder its images lie in.
Result<uint64_t> ImportConverted(ModelReader& bytes, const std::string& model, ModelSink& sink);
Result<uint64_t> ImportObj(ModelReader& bytes, ModelSink& sink);
Result<uint64_t> ImportStl(ModelReader& bytes, ModelSink& sink);
Result<uint64_t> ImportOff(ModelReader& bytes, ModelSink& sink);
Result<uint64_t> ImportGltf(ModelReader& bytes, ModelSink& sink, const GltfDecoding& decoding);
/// Requires: bytes.can_reopen().
Result<uint64_t> ImportThreeMf(ModelReader& bytes, ModelSink& sink);
/// NFF and AFF.
Result<uint64_t> ImportNff(ModelReader& bytes, ModelSink& sink);

/// The error for a model of points only.
tl::unexpected<Error> NoFaces(const std::string& path, uint64_t vertices);

/// Whether the buffered bytes look like an STL file, ASCII or binary, by content alone.
bool LooksLikeStl(ModelReader& bytes);
/// Whether the bytes begin like OFF; like GLB or glTF's JSON; like NFF.
bool LooksLikeOff(ModelReader& bytes);
bool LooksLikeNff(ModelReader& bytes);
bool LooksLikeGltf(ModelReader& bytes);
/// Whether the bytes begin a zip archive, in a file, that holds a 3MF's model.
bool LooksLikeThreeMf(ModelReader& bytes);
/// Whether the bytes look like the text of an OBJ file.
bool LooksLikeObj(ModelReader& bytes);

}  // namespace quarry
