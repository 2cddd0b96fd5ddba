#pragma once

#include "common/base/status.h"
#include "preprocess/import/nff/nff_file.h"

namespace quarry {

/// Each reads the shape behind its keyword ("p" or "pp", "s", "c", "m") and gives its polygons to the sink in
/// world coordinates; in the first pass (NffScene::animations_only) it only counts. Spheres become 528
/// triangles, cones 48.
/// Errors: the text is malformed; too many spheres and cones; the sink's.
Status ReadNffPolygon(NffFile& file, bool normals);
Status ReadNffSphere(NffFile& file);
Status ReadNffCone(NffFile& file);
Status ReadNffMesh(NffFile& file);

}  // namespace quarry
