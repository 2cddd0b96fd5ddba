#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <nlohmann/json_fwd.hpp>
#include <utility>

#include "common/voxel/store_reader.h"

namespace quarry {

/// Sums over a store's blocks and pages. Units: bytes, but for counts of voxels and pages.
struct StoreTotals {
  uint64_t hot_decoded = 0, shading_decoded = 0, stored = 0, chained = 0;
  uint64_t pages = 0, pages_stored = 0, pages_decoded = 0;
};
StoreTotals TotalsOf(const StoreReader& store);

/// The bounds in the model's own coordinates.
std::pair<glm::dvec3, glm::dvec3> ModelBounds(const SceneMeta& meta);

/// A store's facts: `quarry info --json` without the names of materials, parts and textures, which may be
/// millions. Thread-safe.
nlohmann::ordered_json DescribeFacts(const StoreReader& store);
/// The facts and names as `quarry info --json` prints them. Thread-safe. Errors: the file cannot be read.
Result<nlohmann::ordered_json> DescribeStore(const StoreReader& store);
/// The textures alone: shape, bytes, and the materials that use each, with the use. Errors: as
/// DescribeStore().
Result<nlohmann::ordered_json> DescribeTextures(const StoreReader& store);

}  // namespace quarry
