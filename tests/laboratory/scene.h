#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/build/build.h"
#include "common/voxel/store_reader.h"
#include "tests/laboratory/triangles.h"

namespace quarry::laboratory {

/// The shading data of a triangle: what the shade kernel reads at a hit.
struct ShadingRecord {
  uint32_t material;
  uint32_t has_attributes;
  ShadingVertex vertices[3];
};

/// The triangles of a store, each once, in the order of their ids: a triangle's place here stands for its id.
/// Its textures are those of Purcell et al. 2002, figure 4. Immutable once loaded.
class LaboratoryScene {
 public:
  /// Errors: those of stores; textures or cut-outs, which the machine does not have.
  static Result<std::unique_ptr<LaboratoryScene>> Load(const std::string& store);

  const Catalog& catalog() const { return store_->catalog(); }
  /// The cameras and lights of the model.
  const SceneViews& views() const { return store_->views(); }
  const std::vector<KdTriangle>& triangles() const { return triangles_; }
  /// Bound on the distance from a triangle to a hit, scene units; see ReferencePadding().
  float padding() const { return catalog().meta.padding; }
  /// The scene's box, padded.
  Box box() const { return {catalog().meta.root_lower, catalog().meta.root_upper}; }

  /// Addresses behind those of the scene's textures. Not thread-safe.
  AddressSpace& addresses() { return addresses_; }
  const TriangleCorners& corners() const { return corners_; }
  const Texture<Float3>& corner(int i) const { return corners_.corner[i]; }
  const Texture<ShadingRecord>& shading() const { return shading_; }

 private:
  std::unique_ptr<StoreReader> store_;
  std::vector<KdTriangle> triangles_;
  std::vector<Float3> corner_data_[3];
  std::vector<ShadingRecord> records_;
  AddressSpace addresses_;
  TriangleCorners corners_;
  Texture<ShadingRecord> shading_;
};

}  // namespace quarry::laboratory
