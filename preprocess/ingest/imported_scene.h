#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/kdtree/build/build.h"
#include "common/kdtree/ray.h"
#include "common/scene/material.h"
#include "common/scene/scene_views.h"
#include "common/voxel/emitters/emitter.h"
#include "common/voxel/parts/part_sections.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/partition/sample.h"
#include "preprocess/spill/spill_file.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// All triangles of a scene, with their vertices filled in.
/// Units: scene units, after the offset is taken off.
struct ImportedTriangles {
  std::optional<SpillFile> triangles;  ///< TriangleRecords of RecordBytes(attributes); absent before a file
  TriangleSample sample;               ///< a subset of them, from which region planes are chosen
  Attributes attributes = Attributes::kNone;
  Box bounds{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  double up_evidence = 0;        ///< UpEvidence() of the sample, once all triangles are imported
  uint64_t input_triangles = 0;  ///< ids given, dropped triangles included
  uint64_t dropped_degenerate = 0;
  uint64_t dropped_not_finite = 0;
};

/// Tables that triangles refer to by index, and the views of the scene.
struct ImportedTables {
  std::vector<Material> materials;  ///< at least one after the import
  PartTable parts;                  ///< at least one after the import
  std::vector<std::string> warnings;
  std::vector<std::string> notes;  ///< how files were read, a sentence each, for the summary
  SceneViews views;
  std::vector<Emitter> emitters;  ///< the strongest, by ascending triangle
};

/// The result of an import, ready for the partition.
struct ImportedScene : ImportedTriangles, ImportedTables {
  glm::dvec3 offset{0};              ///< scene units; subtracted from every position after scaling
  std::vector<TextureImage> images;  ///< images that materials bind; each lies in a file
};

}  // namespace quarry
