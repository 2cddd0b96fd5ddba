#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/kdtree/build/build.h"
#include "common/kdtree/node.h"
#include "common/voxel/block_key.h"

// A voxel is stored as two blocks: the hot part (tree and triangles, all that traversal touches) and the
// shading part (normals, uv, colours). A block is stored as streams of bytes that LZ4 makes small, and
// decoded into arrays that are used in place, with all that is derived: wide nodes, and where somebody asks
// for it the kd-tree in treelets. FORMAT.md gives the streams byte by byte.

namespace quarry {

inline constexpr uint32_t kHotMagic = 0x35585651;      // "QVX5"
inline constexpr uint32_t kShadingMagic = 0x32535651;  // "QVS2"
inline constexpr size_t kHotHeaderBytes = 52, kShadingHeaderBytes = 12;

/// Most triangles, vertices and references' targets of one voxel: indices are 16 bits.
inline constexpr uint32_t kMaxVoxelTriangles = 21845;
/// No block decodes to more than this, whatever a directory says.
inline constexpr uint32_t kMaxBlockBytes = 64u << 20;

/// A stored block is at most twice as large as it is decoded, and so much: its streams' header, and how many
/// bytes of streams there are. (Of a hot block's tree nothing is left but wide nodes.)
inline constexpr uint64_t MostStored(uint64_t decoded) { return 2 * decoded + 16; }

/// What a hot block is made from.
struct HotVoxel {
  Box cell;
  std::vector<KdNode> nodes;         ///< as built; leaves' references lie in a row, from the leftmost leaf on
  uint32_t node_slots = 0;           ///< that LayOutTreelets takes for them
  uint32_t wide_nodes = 0;           ///< that MakeWideTree makes of them
  std::vector<uint16_t> references;  ///< triangles numbered in the order in which these first name them
  std::vector<uint16_t> corners;     ///< 3 a triangle; vertices numbered likewise
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

/// The streams of a block, before LZ4. The same voxel gives the same bytes.
Bytes EncodeHot(const HotVoxel& voxel);
Bytes EncodeShading(const ShadingVoxel& voxel);

/// Bytes of a decoded block with these counts. Requires of hot blocks: slots of the tree's nodes take no more
/// than that.
size_t HotBytes(size_t wide_nodes, size_t references, size_t triangles, size_t vertices);
size_t ShadingBytes(size_t triangles, size_t vertices);

/// Of the LZ4 at hand, as LZ4_VERSION_NUMBER counts: other versions may give other bytes.
uint32_t CompressorVersion();

/// LZ4 HC over `streams`, or the bytes themselves when that is not smaller; before it their number. Returns
/// what is stored. Deterministic for one LZ4 version.
Bytes CompressBlock(std::span<const std::byte> streams);

}  // namespace quarry
