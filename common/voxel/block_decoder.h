#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/voxel/catalog.h"
#include "common/voxel/voxel_block.h"

namespace quarry {

/// A view of a decoded shading block.
/// Shapes: corners[3 * triangle_count], indices into vertices.
struct VoxelShading {
  const uint16_t* corners = nullptr;
  const ShadingVertex* vertices = nullptr;
  uint32_t triangle_count = 0;

  const ShadingVertex& vertex(uint32_t triangle, int corner) const {
    return vertices[corners[3 * triangle + static_cast<uint32_t>(corner)]];
  }
};

/// Decodes blocks. Keeps working memory from block to block: the streams and the tree, each of about the size
/// of a decoded block. Not thread-safe.
class BlockDecoder {
 public:
  BlockDecoder();
  ~BlockDecoder();

  /// Decodes a stored hot block into `out`; the returned view points into `out`. The boxes of wide nodes are
  /// grown by `padding`, the scene's. With `tree`, the kd-tree is stored there in treelets, for kernels that
  /// visit its nodes; without it the view has no nodes.
  /// Units: `padding` in scene units.
  /// Requires: out.size() is the decoded size in the directory; `out` aligned to 16 bytes.
  /// Errors: data that does not decode to exactly `out`; a count, index or link out of range; an invalid
  /// tree; leaves with another number of references than the block; a part of 2^31 or above. Any bytes may be
  /// given; after success kernels need no further check.
  /// No triangle is see-through yet: see MarkSeeThrough().
  Result<VoxelGeometry> Hot(std::span<const std::byte> stored, std::span<std::byte> out, float padding,
                            std::vector<KdNode>* tree = nullptr);
  /// Decodes a stored shading block into `out`, under the contract of Hot().
  Result<VoxelShading> Shading(std::span<const std::byte> stored, std::span<std::byte> out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Marks the triangles whose material lets light through, or whose mask is not all opaque.
/// Requires: `hot` is a decoded block that no other thread reads yet; its materials are below
/// materials.size().
void MarkSeeThrough(const std::vector<Material>& materials, VoxelGeometry& hot);

/// Decode a block of voxel `voxel` of `catalog`, as the members above. See-through triangles are marked.
/// Errors: as there; another number of triangles than the directory's; for a hot block, a material that the
/// scene lacks.
Result<VoxelGeometry> DecodeHot(BlockDecoder& decoder, const Catalog& catalog, uint32_t voxel,
                                std::span<const std::byte> stored, std::span<std::byte> out,
                                std::vector<KdNode>* tree = nullptr);
Result<VoxelShading> DecodeShading(BlockDecoder& decoder, const Catalog& catalog, uint32_t voxel,
                                   std::span<const std::byte> stored, std::span<std::byte> out);

}  // namespace quarry
