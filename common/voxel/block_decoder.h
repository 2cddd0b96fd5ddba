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

/// A decoded shading block.
struct VoxelShading {
  const uint16_t* corners = nullptr;
  const ShadingVertex* vertices = nullptr;
  uint32_t triangle_count = 0;

  const ShadingVertex& vertex(uint32_t triangle, int corner) const {
    return vertices[corners[3 * triangle + static_cast<uint32_t>(corner)]];
  }
};

/// Decodes blocks; working memory is kept from one to the next: a block's streams and its tree, each of at
/// most about a decoded block's size. Not thread-safe.
class BlockDecoder {
 public:
  BlockDecoder();
  ~BlockDecoder();

  /// Decodes a stored block into `out`, whose size is the decoded size that the directory gives, aligned to
  /// 16; the view points into it. Boxes of wide nodes are grown by the scene's `padding`. The kd-tree itself,
  /// for kernels that go by its nodes, is put into `tree` in treelets; without it the view has no nodes.
  /// Errors: whatever does not decode to just `out`; any count, index or link that leads out of the block; a
  /// tree that is none, or whose leaves have other references than there are. After success kernels need no
  /// further check.
  Result<VoxelGeometry> Hot(std::span<const std::byte> stored, std::span<std::byte> out, float padding,
                            std::vector<KdNode>* tree = nullptr);
  Result<VoxelShading> Shading(std::span<const std::byte> stored, std::span<std::byte> out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The blocks of a voxel of `catalog`, as above. Errors also: other triangles than the directory's; a
/// material that the scene lacks.
Result<VoxelGeometry> DecodeHot(BlockDecoder& decoder, const Catalog& catalog, uint32_t voxel,
                                std::span<const std::byte> stored, std::span<std::byte> out,
                                std::vector<KdNode>* tree = nullptr);
Result<VoxelShading> DecodeShading(BlockDecoder& decoder, const Catalog& catalog, uint32_t voxel,
                                   std::span<const std::byte> stored, std::span<std::byte> out);

}  // namespace quarry
