#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/base/resource.h"
#include "common/base/status.h"
#include "common/kdtree/build/build.h"
#include "common/voxel/store_reader.h"
#include "tests/laboratory/triangles.h"

namespace quarry::laboratory {

/// A triangle's word of shading: its material's index, and in the top bit whether it has attributes. The
/// materials themselves are few: they are constants of the kernels and no words of memory.
struct TriangleMaterial {
  uint32_t bits = 0;

  /// Requires: material < 2^31.
  static TriangleMaterial Of(uint32_t material, bool has_attributes) {
    QUARRY_CHECK_LT(material, kAttributes);
    return {material | (has_attributes ? kAttributes : 0)};
  }
  uint32_t material() const { return bits & ~kAttributes; }
  bool has_attributes() const { return (bits & kAttributes) != 0; }

 private:
  static constexpr uint32_t kAttributes = 1u << 31;
};

/// The attributes of a triangle's corners, which the shade kernel reads too where a triangle has them.
struct TriangleAttributes {
  ShadingVertex vertices[3];
};

/// Memory of structures and of their building, bytes a triangle: the most of the papers' scenes of a million
/// triangles, the forest in a grid of 64 cells and in a tree as Foley's with ropes: peak resident memory,
/// less the scene, of `quarry-bench-stream stream-forest.quarry --only raycast --size 8` with --structure
/// grid and with --structure ropes --tree theirs.
inline constexpr uint64_t kGridBytes = 380, kTreeBytes = 140;
/// Bytes a cell of a grid while it is built: a count, then a place.
inline constexpr uint64_t kCellBytes = 8;

/// A program's need of memory beside the scene.
struct MemoryNeeds {
  uint64_t structure_bytes = kGridBytes;  ///< a triangle
  uint64_t cells = 0;                     ///< of a grid
  uint64_t pixels = 0;                    ///< of the picture that it renders; 0: none
  uint64_t bytes_per_pixel = 0;           ///< of its largest state while it renders
  bool twice = false;  ///< between pictures, a child process or another renderer holds the scene as well
  uint64_t limit = MemoryLimitBytes();
};

/// Checks before anything large is allocated. It is an estimate: scenes of other shapes may take more.
/// Errors: the scene, its structure, and the larger of the picture and the second scene take more than
/// needs.limit; the message names `store`, both sizes and the remedy.
Status CheckMemory(const std::string& store, const Catalog& catalog, const MemoryNeeds& needs);

/// Memory for decoded blocks, aligned as decoders ask.
class BlockMemory {
 public:
  /// Valid until the next call.
  std::span<std::byte> Fit(size_t bytes) {
    memory_.resize((bytes + sizeof(Line) - 1) / sizeof(Line));
    return {memory_.data()->bytes, bytes};
  }

 private:
  struct alignas(64) Line {
    std::byte bytes[64];
  };
  std::vector<Line> memory_;
};

/// The triangles of a store, each once, in the order of their ids: a triangle's place here stands for its id.
/// Its textures are as in Purcell et al. 2002, figure 4. Immutable once loaded.
class LaboratoryScene {
 public:
  /// Errors: textures or cut-outs, which the machine does not have; errors of CheckMemory().
  static Status Check(const std::string& store, const Catalog& catalog, const MemoryNeeds& needs);
  /// Errors: as of stores and of Check().
  static Result<std::unique_ptr<LaboratoryScene>> Load(const std::string& store,
                                                       const MemoryNeeds& needs = {});
  /// Memory of a loaded scene, and while it is loaded. `attributes`: a triangle has some.
  static uint64_t BytesPerTriangle(bool attributes);

  const Catalog& catalog() const { return store_->catalog(); }
  const StoreReader& store() const { return *store_; }
  /// The cameras and lights of the model.
  const SceneViews& views() const { return store_->views(); }
  const std::vector<KdTriangle>& triangles() const { return triangles_; }
  /// The place of the triangle `id`. Requires: a voxel has it.
  uint32_t PlaceOf(uint32_t id) const;
  /// Bound on the distance from a triangle to a hit, scene units; see ReferencePadding().
  float padding() const { return catalog().meta.padding; }
  /// The scene's box, padded.
  Box box() const { return {catalog().meta.root_lower, catalog().meta.root_upper}; }

  /// Addresses behind the addresses of the scene's textures. Not thread-safe.
  AddressSpace& addresses() { return addresses_; }
  const TriangleCorners& corners() const { return corners_; }
  const Texture<Float3>& corner(int i) const { return corners_.corner[i]; }
  const Texture<TriangleMaterial>& materials() const { return material_; }
  /// Empty if no triangle has attributes.
  const Texture<TriangleAttributes>& attributes() const { return attribute_; }

 private:
  Status ReadTriangles();

  std::unique_ptr<StoreReader> store_;
  std::vector<uint32_t> ids_;  ///< of the triangles, ascending
  std::vector<KdTriangle> triangles_;
  std::vector<Float3> corner_data_[3];
  std::vector<TriangleMaterial> materials_;
  std::vector<TriangleAttributes> attributes_;
  AddressSpace addresses_;
  TriangleCorners corners_;
  Texture<TriangleMaterial> material_;
  Texture<TriangleAttributes> attribute_;
};

}  // namespace quarry::laboratory
