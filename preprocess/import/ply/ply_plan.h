#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "preprocess/import/ply/ply_header.h"
#include "preprocess/import/ply/ply_rows.h"

namespace quarry {

/// Slots in PlyRow::values for the properties of vertices and of faces.
enum VertexSlot : uint8_t { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kAlpha, kU, kV };
enum FaceSlot : uint8_t { kMaterial, kPart, kTextureNumber };  // faces also use kRed to kAlpha

/// PlyPlan::color_scale of real channels, which run to 1.
inline constexpr double kScaleOfReal = 255;
/// A real channel beyond this means that channels run to 255 from there on, instead of 1.
inline constexpr double kMostOfOne = 2;

/// The plan of an element's rows, and the slots that it fills.
struct PlyPlan {
  std::vector<PlyStep> steps;
  uint32_t filled = 0;
  double color_scale[4] = {1, 1, 1, 1};  ///< factors for red, green, blue, alpha to reach 0..255
  bool has_index_list = false;
  bool has_uv_list = false;  ///< of a face: u and v of each corner
  bool has_lists = false;    ///< whether rows differ in size
  /// Bytes of a face's row with three corners, if the list comes first, has a count of one byte and 32-bit
  /// indices, and is the only list; else 0.
  uint32_t triangle_bytes = 0;

  /// Whether the slots `first` to `last` are all filled.
  bool Has(uint8_t first, uint8_t last) const {
    for (int slot = first; slot <= last; ++slot)
      if (!(filled >> slot & 1)) return false;
    return true;
  }
};

PlyPlan PlanVertex(const PlyElement& element);
/// Also for tristrips, whose index list has the faces' names.
PlyPlan PlanFace(const PlyElement& element);
PlyPlan PlanToSkip(const PlyElement& element);

}  // namespace quarry
