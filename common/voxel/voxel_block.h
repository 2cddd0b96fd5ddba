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
#include "common/kdtree/opacity_mask.h"
#include "common/voxel/block_key.h"

// A voxel is stored as two blocks: hot (the tree and triangles, all that traversal reads) and shading
// (normals, uv, colours). A block is stored as streams of bytes that LZ4 compresses well. It is decoded into
// arrays that are used in place, together with derived arrays: the wide nodes and, on request, the kd-tree in
// treelets. FORMAT.md gives the streams byte by byte.

namespace quarry {

inline constexpr uint32_t kHotMagic = 0x35585651;      // "QVX5"
inline constexpr uint32_t kMaskedMagic = 0x37585651;   // "QVX7": with opacity masks
inline constexpr uint32_t kShadingMagic = 0x32535651;  // "QVS2"
inline constexpr uint32_t kPackedMagic = 0x33535651;   // "QVS3": normals packed in 4 bytes
inline constexpr size_t kHotHeaderBytes = 52, kMaskedHeaderBytes = 56, kShadingHeaderBytes = 12,
                        kPackedHeaderBytes = 16;
/// The columns of a packed shading block beside its normals.
inline constexpr uint32_t kPackedUvs = 1, kPackedColors = 2;

/// Most triangles of a voxel: 3 * 21,845 corners number at most 65,535 vertices, and indices are 16 bits.
inline constexpr uint32_t kMaxVoxelTriangles = 21845;
/// Limit of a decoded block in bytes, whatever a directory states: it bounds allocations.
inline constexpr uint32_t kMaxBlockBytes = 64u << 20;

/// Most bytes of a stored block: twice the decoded size, plus the streams' header and their size. (Streams of
/// a hot block can exceed its decoded size: the decoded tree is only wide nodes.)
inline constexpr uint64_t MostStored(uint64_t decoded) { return 2 * decoded + 16; }

/// The input of a hot block.
/// Units: `cell` and `vertices` in scene units.
/// Shapes: corners[3 * triangles]; triangle_ids, materials and parts one per triangle.
struct HotVoxel {
  Box cell;
  std::vector<KdNode> nodes;         ///< as built; references in the order of the leaves
  uint32_t node_slots = 0;           ///< slots that LayOutTreelets() needs for `nodes`
  uint32_t wide_nodes = 0;           ///< wide nodes that MakeWideTree() makes of `nodes`
  std::vector<uint16_t> references;  ///< triangles are numbered in the order of their first reference
  std::vector<uint16_t> corners;     ///< 3 per triangle; vertices are numbered likewise
  std::vector<glm::vec3> vertices;
  std::vector<uint32_t> triangle_ids;
  std::vector<uint16_t> materials;
  std::vector<uint32_t> parts;
  std::vector<uint32_t> masks;       ///< opacity_mask.h; one per triangle, or none
  std::vector<FineMask> fine_masks;  ///< named by `masks`
};

/// The attributes of a triangle's corner. A zero normal means that the triangle's own normal is used.
struct ShadingVertex {
  glm::vec3 normal{0};
  glm::vec2 uv{0};
  uint32_t color = 0xFFFFFFFFu;  ///< r, g, b, a from the lowest byte

  bool operator==(const ShadingVertex&) const = default;
};
static_assert(sizeof(ShadingVertex) == 24, "stored");

/// The input of a shading block; triangles in the hot block's order.
struct ShadingVoxel {
  std::vector<uint16_t> corners;  ///< 3 per triangle: indices into vertices
  std::vector<ShadingVertex> vertices;
  bool packed = false;  ///< each normal is zero or UnpackNormal(PackNormal(normal)), and is stored so
};

/// Encode the streams of a block, before LZ4. The same voxel gives the same bytes. Thread-safe.
Bytes EncodeHot(const HotVoxel& voxel);
Bytes EncodeShading(const ShadingVoxel& voxel);

/// Size in bytes of a decoded block with these counts. `masks`: triangles that have an opacity mask, all or
/// none; `fine_masks`: the table of fine masks.
/// Requires, for hot blocks: the slots of the tree's nodes take no more bytes than the block.
size_t HotBytes(size_t wide_nodes, size_t references, size_t triangles, size_t vertices, size_t masks = 0,
                size_t fine_masks = 0);
size_t ShadingBytes(size_t triangles, size_t vertices);

/// The version of the LZ4 in use (LZ4_VERSION_NUMBER). Other versions may compress to other bytes.
uint32_t CompressorVersion();

/// Compresses `streams` with LZ4 HC, or keeps them when that is not smaller; the size of `streams` comes
/// first. Returns: the stored bytes, deterministic for one LZ4 version. Thread-safe.
Bytes CompressBlock(std::span<const std::byte> streams);

}  // namespace quarry
