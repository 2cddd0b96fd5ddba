#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "preprocess/import/ply/ply_header.h"
#include "preprocess/import/ply/ply_rows.h"

namespace quarry {

/// Places in PlyRow::values for the properties of a vertex, of a face.
enum VertexSlot : uint8_t { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kAlpha, kU, kV };
enum FaceSlot : uint8_t { kMaterial, kPart };  // and kRed to kAlpha

/// PlyPlan::color_scale of real numbers, to 1.
inline constexpr double kScaleOfReal = 255;
/// A real channel beyond this counts to 255, not to 1: from there on all do.
inline constexpr double kMostOfOne = 2;

/// The plan of one element, and which slots it fills.
struct PlyPlan {
  std::vector<PlyStep> steps;
  uint32_t filled = 0;
  double color_scale[4] = {1, 1, 1, 1};  ///< Brings red, green, blue, alpha to 0..255.
  bool has_index_list = false;
  bool has_lists = false;  ///< Any list at all: rows differ in size.
  /// Of a face's row with three corners where the list comes first, counted by a byte, of 32-bit indices, and
  /// is the only one; else 0.
  uint32_t triangle_bytes = 0;

  /// True if the slots `first` to `last` are all filled.
  bool Has(uint8_t first, uint8_t last) const {
    for (int slot = first; slot <= last; ++slot)
      if (!(filled >> slot & 1)) return false;
    return true;
  }
};

PlyPlan PlanVertex(const PlyElement& element);
/// Also for tristrips, which name their indices as faces do.
PlyPlan PlanFace(const PlyElement& element);
PlyPlan PlanToSkip(const PlyElement& element);

}  // namespace quarry
