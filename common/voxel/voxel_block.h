#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/kdtree/build.h"
#include "common/kdtree/node.h"
#include "common/kdtree/voxel_geometry.h"

// A voxel is stored as two blocks: the hot part (tree and triangles, all that traversal touches) and the
// shading part (normals, uv, colours). FORMAT.md gives both byte by byte. A decoded block is used in place.

namespace quarry {

/// Most triangles, vertices and references' targets of one voxel: indices are 16 bits.
inline constexpr uint32_t kMaxVoxelTriangles = 21845;
/// No block decodes to more than this, whatever a directory says.
inline constexpr uint32_t kMaxBlockBytes = 64u << 20;

enum class BlockKind : uint32_t { kHot = 0, kShading = 1 };

/// The blocks of a scene are numbered: voxel * 2 + kind.
inline uint32_t BlockId(uint32_t voxel, BlockKind kind) { return voxel * 2 + static_cast<uint32_t>(kind); }

/// What a hot block is made from.
struct HotVoxel {
  Box cell;
  std::vector<KdNode> nodes;  ///< in treelets (LayOutTreelets)
  uint32_t wide_nodes = 0;    ///< that MakeWideTree makes of them
  std::vector<uint16_t> references;
  std::vector<uint16_t> corners;  ///< 3 a triangle
  std::vector<glm::vec3> vertices;
  std::vector<uint32_t> triangle_ids;
  std::vector<uint16_t> materials;
  std::vector<uint32_t> parts;
};

/// One corner's attributes. A zero normal means none: the triangle's own is used.
struct ShadingVertex {
  glm::vec3 normal{0};
  glm::vec2 uv{0};
  uint32_t color = 0xFFFFFFFFu;  ///< r, g, b, a from the lowest byte

  bool operator==(const ShadingVertex&) const = default;
};
static_assert(sizeof(ShadingVertex) == 24, "stored");

/// What a shading block is made from; triangles in the hot block's order.
struct ShadingVoxel {
  std::vector<uint16_t> corners;  ///< 3 a triangle: indices into vertices
  std::vector<ShadingVertex> vertices;
};

/// A decoded shading block.
struct VoxelShading {
  const uint16_t* corners = nullptr;
  const ShadingVertex* vertices = nullptr;
  uint32_t triangle_count = 0;

  const ShadingVertex& vertex(uint32_t triangle, int corner) const {
    return vertices[corners[3 * triangle + static_cast<uint32_t>(corner)]];
  }
};

/// The decoded form: what a resident block's bytes are.
Bytes LayOutHot(const HotVoxel& voxel);
Bytes LayOutShading(const ShadingVoxel& voxel);

/// Decoded bytes of a hot block with these counts.
size_t HotBytes(size_t nodes, size_t wide_nodes, size_t references, size_t triangles, size_t vertices);

/// Views a decoded block in place, and fills in what is derived: its tree's treelet headers and wide nodes,
/// whose boxes are grown by the scene's `padding`. `bytes` must outlive the view and be aligned to 16.
/// Errors: any count, index or link that leads out of the block, a tree that does not lie in treelets, a leaf
/// beyond the references. After success kernels need no further check.
Result<VoxelGeometry> ViewHot(std::span<std::byte> bytes, float padding);
Result<VoxelShading> ViewShading(std::span<const std::byte> bytes);

/// LZ4 HC over `decoded`; the bytes themselves when that is not smaller. Deterministic for one LZ4 version.
Bytes CompressBlock(std::span<const std::byte> decoded);

/// The reverse, into `out`, whose size is the decoded size the directory gives.
/// Errors: does not decode to exactly that many bytes. Reads and writes nothing outside the spans.
Status DecompressBlock(std::span<const std::byte> stored, std::span<std::byte> out);

}  // namespace quarry
