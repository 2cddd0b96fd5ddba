#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "preprocess/import/cad/cad_protocol.h"
#include "preprocess/import/cad/cad_reading.h"
#include "preprocess/import/model_reader.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Reads a STEP or IGES file by quarry-import-cad: parts by their path in the assembly, colours of shapes and
/// faces as materials, triangles with normals of curved surfaces. Between BeginFile() and EndFile(), which
/// are the caller's. Returns: the number of triangles. Requires: reading.program. Errors: a sentence with the
/// path; the file is larger than reading.memory allows; CadClient's; the sink's.
Result<uint64_t> ImportCad(ModelReader& bytes, CadFormat format, const CadReading& reading, ModelSink& sink);

}  // namespace quarry
