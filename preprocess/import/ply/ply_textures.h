#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/import/ply/ply_header.h"

namespace quarry {

/// Registers a white material for each image that "comment TextureFile" names (MeshLab, photogrammetry), and
/// returns their indices in the scene, in order. An image that is not there leaves its material without, with
/// a warning. Nothing is returned when the header names none, or the sink takes no textures. `path`: the
/// model's. Errors: the sink's.
Result<std::vector<uint32_t>> AddPlyTextures(const PlyHeader& header, const std::string& path,
                                             ModelSink& sink);

}  // namespace quarry
