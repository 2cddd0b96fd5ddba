#pragma once

#include <string>

#include "common/base/status.h"
#include "preprocess/import/foreign/foreign.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Reads the model file at `path` into `sink` (BeginFile ... EndFile), choosing the format by content first
/// and by extension second: PLY (ASCII, binary little and big endian), OBJ with its MTL files, STL (ASCII,
/// binary), OFF (ASCII), NFF and AFF, glTF 2.0 and GLB; what is none of these by way of `foreign`. All but
/// glTF may be packed by gzip or zstd, or come from standard input, "-". Memory: at most 6 MiB, whatever the
/// file, plus names and materials, and for glTF its JSON. Errors: one sentence with the path and the line
/// (text) or byte (binary): cannot be opened, truncated, unreadable, format not known, no triangles at all.
/// `sink` may have been given part of the file by then. `unpack_limit`: as ModelReader::Open has it.
Status ImportModel(const std::string& path, ModelSink& sink, const ForeignFormats& foreign = {},
                   uint64_t unpack_limit = 0);

}  // namespace quarry
