#pragma once

#include <TopLoc_Location.hxx>
#include <TopoDS_Face.hxx>
#include <cstdint>

#include "preprocess/import/cad/open_cascade/cad_output.h"

namespace quarry {

/// Sends the triangles of a meshed face at a place, with normals of its surface where it is curved. `scale`
/// multiplies coordinates. False: the face has no triangles, and nothing is sent.
bool SendFace(const TopoDS_Face& face, const TopLoc_Location& place, double scale, uint32_t material,
              CadOutput& out);

}  // namespace quarry
