#pragma once

#include <string>

#include "common/base/status.h"
#include "preprocess/import/cad/cad_reading.h"
#include "preprocess/import/foreign/foreign.h"
#include "preprocess/import/gltf/gltf_decoding.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Reads the model file at `path` into `sink`, from BeginFile() to EndFile(). The format is chosen by
/// content, then by extension: PLY (ASCII, binary), OBJ with MTL, STL (ASCII, binary), OFF (ASCII), NFF and
/// AFF, glTF 2.0 and GLB, whose compressed parts go by `decoding`, 3MF; STEP and IGES by `cad`; others
/// through `foreign`. All but glTF and 3MF may be packed by gzip or zstd, or come from standard input ("-").
/// Units: unpack_limit in bytes, see ModelReader::Open(). Memory: at most 6 MiB, plus names and materials,
/// and glTF's JSON; GltfDecoding::memory for compressed parts of glTF. Errors: a sentence with the path and
/// the line (text) or byte (binary): cannot be opened, truncated, malformed, unknown format, no triangles.
/// The sink may have received part of the file by then.
Status ImportModel(const std::string& path, ModelSink& sink, const ForeignFormats& foreign = {},
                   uint64_t unpack_limit = 0, const GltfDecoding& decoding = {}, const CadReading& cad = {});

}  // namespace quarry
