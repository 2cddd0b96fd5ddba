#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/kdtree/node.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/scene/material.h"
#include "common/voxel/voxel_block.h"

// The catalog is what every worker holds whole: facts about the scene, the top-level tree, the voxel
// directory and the materials. It is stored as four sections and sent as the same bytes.

namespace quarry {

/// Section types; FORMAT.md says what each holds.
enum class SectionType : uint32_t {
  kMeta = 0x4154454D,              // "META"
  kTopTree = 0x54504F54,           // "TOPT"
  kDirectory = 0x52494456,         // "VDIR"
  kMaterials = 0x4C54414D,         // "MATL"
  kParts = 0x54524150,             // "PART"
  kStrings = 0x53525453,           // "STRS"
  kBlocks = 0x534B4C42,            // "BLKS"
  kProxies = 0x584F5250,           // "PROX", reserved
  kTexturePages = 0x50584554,      // "TEXP"
  kTextureDirectory = 0x44584554,  // "TEXD"
  kMaterialTextures = 0x5845544D,  // "MTEX"
  kCameras = 0x534D4143,           // "CAMS"
  kLights = 0x4554494C,            // "LITE"
};

/// Facts about a scene.
struct SceneMeta {
  glm::vec3 bounds_lower{0}, bounds_upper{0};  ///< of the triangles, scene units
  glm::vec3 root_lower{0}, root_upper{0};      ///< of the top-level tree: the bounds, padded
  float padding = 0;                           ///< see ReferencePadding
  uint32_t up_axis = 2;                        ///< 1 for y, 2 for z
  glm::dvec3 offset{0};                        ///< added to stored positions gives the input's
  double unit_in_metres = 1;                   ///< length of one scene unit, 1 when not known
  uint64_t input_triangles = 0;                ///< ids run below this: dropped triangles keep theirs
  uint64_t dropped_degenerate = 0;             ///< zero area
  uint64_t dropped_not_finite = 0;             ///< NaN, infinite or beyond 2^60
  uint64_t stored_references = 0;              ///< triangles over all voxels, with replication
  uint32_t voxel_size = 0;                     ///< bytes aimed at for a decoded hot block
  uint32_t largest_decoded = 0;                ///< bytes of the largest decoded block of either kind
  uint32_t largest_stored = 0;                 ///< bytes of the largest stored block
  uint32_t lz4_version = 0;                    ///< LZ4_VERSION_NUMBER that compressed the blocks

  bool operator==(const SceneMeta&) const = default;
};

/// One block as the directory knows it.
struct BlockEntry {
  uint64_t offset = 0;    ///< in the file
  uint32_t stored = 0;    ///< bytes in the file; 0: there is no such block
  uint32_t decoded = 0;   ///< bytes once decompressed
  uint64_t checksum = 0;  ///< of the stored bytes

  bool operator==(const BlockEntry&) const = default;
};

/// One voxel as the directory knows it. Stored in 72 bytes.
struct VoxelEntry {
  BlockEntry blocks[kBlockKinds];  ///< by BlockKind; shading follows hot in the file
  uint32_t triangles = 0;
  uint32_t next_in_chain = kNoIndex;           ///< the next voxel of the same top-level leaf
  glm::vec3 bounds_lower{0}, bounds_upper{0};  ///< of its triangles, whole

  bool operator==(const VoxelEntry&) const = default;
};

/// 128 bits over a scene's logical content, whatever the compressor. Caches are keyed by (scene id, block
/// id).
using SceneId = std::array<uint8_t, 16>;
std::string FormatSceneId(const SceneId& id);

struct Catalog {
  SceneId id{};
  SceneMeta meta;
  std::vector<KdNode> top_nodes;   ///< in treelets, headers filled in
  std::vector<WideNode> top_wide;  ///< the same in wide nodes, cut down to voxels
  uint32_t top_node_count = 0;     ///< as stored, without headers
  std::vector<VoxelEntry> voxels;
  std::vector<uint32_t> chain_end;  ///< per voxel, for the kernels: see TopTree
  std::vector<VoxelBounds> bounds;  ///< likewise, grown by the padding
  std::vector<Material> materials;  ///< without names

  /// Requires: a voxel of the scene.
  const BlockEntry& block(BlockKey key) const {
    return voxels[key.voxel].blocks[static_cast<uint32_t>(key.kind)];
  }
  /// Whether the scene has this block: a key from elsewhere may name none.
  bool Has(BlockKey key) const { return key.voxel < voxels.size() && block(key).stored != 0; }
  /// Blocks that there may be: their numbers lie below.
  size_t block_numbers() const { return voxels.size() * kBlockKinds; }
  TopTree top_tree() const {
    return {top_nodes.data(), chain_end.data(), bounds.data(),
            meta.root_lower,  meta.root_upper,  top_wide.data()};
  }
};

/// A section's bytes and, in the reader's hands, where they came from.
struct Section {
  SectionType type;
  Bytes bytes;
};

Bytes EncodeMeta(const SceneMeta& meta);
Bytes EncodeTopTree(const std::vector<KdNode>& nodes);
Bytes EncodeDirectory(const std::vector<VoxelEntry>& voxels);
/// The numbers of a material, without its name and textures.
void PutMaterial(const Material& material, ByteWriter& out);
/// The same back, whatever they are: see IsSane. Errors: none; flags that there are not make `in` not ok().
Material GetMaterial(ByteReader& in);
/// Appends names to `strings` and refers to them.
Bytes EncodeMaterials(const std::vector<Material>& materials, std::string& strings);

/// Puts a catalog together from its four sections (others are ignored), everything checked: kernels and
/// caches may believe it. Errors: a section missing or of the wrong size, a link, offset or size out of
/// range.
Result<Catalog> DecodeCatalog(const SceneId& id, const std::vector<Section>& sections);

/// One byte string for the wire, and back. The four sections, each as type, size, checksum, bytes.
Bytes PackSections(const std::vector<Section>& sections);
Result<std::vector<Section>> UnpackSections(std::span<const std::byte> bytes);

}  // namespace quarry
