#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "preprocess/import/byte_reader.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// A polygon of more corners than this is taken for a broken file.
inline constexpr uint64_t kMaxPolygonCorners = 65536;

/// Each reads one file, from its first byte, into `sink` between BeginFile and EndFile, which are the
/// caller's. Returns the number of triangles that the polygons given make. Errors: as ImportModel().
Result<uint64_t> ImportPly(ByteReader& bytes, ModelSink& sink);
Result<uint64_t> ImportObj(ByteReader& bytes, ModelSink& sink);
Result<uint64_t> ImportStl(ByteReader& bytes, ModelSink& sink);

/// True if the bytes available look like an STL file, ASCII or binary, judging by content alone.
bool LooksLikeStl(ByteReader& bytes);
/// True if they look like the text of an OBJ file.
bool LooksLikeObj(ByteReader& bytes);

}  // namespace quarry
