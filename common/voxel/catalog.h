#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/kdtree/build/box8.h"
#include "common/kdtree/node.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/scene/material.h"
#include "common/voxel/emitters/emitter.h"
#include "common/voxel/environment/sky_table.h"
#include "common/voxel/texture_shape.h"
#include "common/voxel/voxel_block.h"

// The catalog is the part of a scene that every worker holds whole: facts about the scene, the top-level
// tree, the directories of voxels and texture pages, the materials and their textures. It is stored as four
// to seven sections and sent as the same bytes.

namespace quarry {

/// Types of sections. FORMAT.md gives their contents.
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
  kPartTree = 0x45525450,          // "PTRE"
  kVoxelParts = 0x54525056,        // "VPRT"
  kPartAttributes = 0x54544150,    // "PATT"
  kEmitters = 0x54494D45,          // "EMIT"
  kMappedEmitters = 0x50414D45,    // "EMAP"
  kModels = 0x534C444D,            // "MDLS"
  kEnvironment = 0x52564E45,       // "ENVR"
};

/// Limits of section MDLS: how many models it names, and the bytes of a name, its end excluded.
inline constexpr size_t kMostModelNames = 256, kMostModelNameBytes = 255;

/// Facts about a scene.
/// Units: lengths and positions in scene units, sizes in bytes.
struct SceneMeta {
  glm::vec3 bounds_lower{0}, bounds_upper{0};  ///< box of the triangles
  glm::vec3 root_lower{0}, root_upper{0};      ///< box of the top-level tree: the bounds, padded
  float padding = 0;                           ///< see ReferencePadding()
  uint32_t up_axis = 2;                        ///< 1 for y, 2 for z
  glm::dvec3 offset{0};                        ///< stored position + offset = input position
  double unit_in_metres = 1;                   ///< length of a scene unit in metres; 1 when unknown
  uint64_t input_triangles = 0;                ///< triangle ids are below this; dropped triangles keep their
                                               ///< ids
  uint64_t dropped_degenerate = 0;             ///< triangles without area
  uint64_t dropped_not_finite = 0;             ///< triangles with a NaN, infinite or larger than 2^60
                                               ///< coordinate
  uint64_t dropped_transparent = 0;            ///< triangles that their opacity's texture cuts out all over
  bool uncolored = false;                      ///< no vertex has a colour; false where that is not known
  bool masks = false;                          ///< some hot blocks have opacity masks, see opacity_mask.h
  uint64_t stored_references = 0;              ///< triangles over all voxels, copies included
  uint32_t voxel_size = 0;                     ///< target size of a decoded hot block
  uint32_t largest_decoded = 0;                ///< largest decoded block, once decoded pages too
  uint32_t largest_stored = 0;                 ///< largest stored block, likewise
  uint32_t lz4_version = 0;                    ///< LZ4_VERSION_NUMBER of the compressor

  uint64_t kept_triangles() const {
    return input_triangles - dropped_degenerate - dropped_not_finite - dropped_transparent;
  }
  bool operator==(const SceneMeta&) const = default;
};

/// The directory's entry of a block or texture page. Units: bytes.
struct BlockEntry {
  uint64_t offset = 0;    ///< position in the file
  uint32_t stored = 0;    ///< size in the file; 0 when there is no such block
  uint32_t decoded = 0;   ///< size when decoded
  uint64_t checksum = 0;  ///< checksum of the stored bytes

  bool operator==(const BlockEntry&) const = default;
};

/// The directory's entry of a voxel; 72 bytes in the file.
struct VoxelEntry {
  BlockEntry blocks[kVoxelBlocks];  ///< indexed by BlockKind; shading follows hot in the file
  uint32_t triangles = 0;
  uint32_t next_in_chain = kNoIndex;           ///< next voxel of the same top-level leaf; kNoIndex at the end
  glm::vec3 bounds_lower{0}, bounds_upper{0};  ///< box of its whole triangles, scene units

  bool operator==(const VoxelEntry&) const = default;
};

/// The directory's entry of a texture.
struct Texture {
  std::string name;  ///< the model's name for it, for writing; readers ask StoreNames
  TexelLayout layout;
  std::vector<BlockEntry> pages;  ///< numbered as in TextureShape

  bool operator==(const Texture&) const = default;
};

/// The bytes that a decoded page counts in a cache: whole pages of memory, and the cache's notes about it.
inline constexpr uint32_t PageRoom(uint32_t decoded) {
  constexpr uint32_t kMemoryPage = 4096, kNotes = 256;
  return (decoded + kMemoryPage - 1) / kMemoryPage * kMemoryPage + kNotes;
}

/// A hash of 128 bits over a scene's logical content, independent of the compressor. Caches use the key
/// (scene id, block number).
using SceneId = std::array<uint8_t, 16>;
/// The id as 32 hexadecimal digits.
std::string FormatSceneId(const SceneId& id);
/// The inverse of FormatSceneId(). Errors: another text.
Result<SceneId> ParseSceneId(std::string_view text);

/// The decoded catalog. Unchanged after DecodeCatalog(), so it may be read from any thread.
struct Catalog {
  SceneId id{};
  SceneMeta meta;
  std::vector<KdNode> top_nodes;   ///< top-level tree in treelets, headers filled in
  std::vector<WideNode> top_wide;  ///< the same tree as wide nodes, boxes cut down to voxels
  uint32_t top_node_count = 0;     ///< stored nodes, headers not counted
  std::vector<VoxelEntry> voxels;
  std::vector<uint32_t> chain_end;  ///< per voxel, for kernels: see TopTree
  std::vector<VoxelBounds> bounds;  ///< per voxel, grown by the padding
  std::vector<Material> materials;  ///< names are left out
  std::vector<Emitter> emitters;    ///< the strongest, by ascending triangle
  bool names_emitters = false;      ///< false: the store was made by a version that named none
  std::vector<Texture> textures;
  std::vector<TextureShape> shapes;     ///< by texture
  std::vector<uint32_t> first_page{0};  ///< by texture, and one past the last: pages of earlier textures
  /// Set: the store is an environment's, of no triangles and one texture. Null: it is a scene's.
  std::shared_ptr<const SkyTable> sky;

  /// Requires: the scene has the key's voxel or page.
  const BlockEntry& block(BlockKey key) const {
    if (key.kind() == BlockKind::kPage) return textures[TextureOf(key)].pages[PageOf(key)];
    return voxels[key.index()].blocks[static_cast<uint32_t>(key.kind())];
  }
  /// Whether the scene has this block.
  bool Has(BlockKey key) const {
    const size_t most = key.kind() == BlockKind::kPage ? first_page.back() : voxels.size();
    return key.index() < most && block(key).stored != 0;
  }
  /// The number of a block in messages, in the files of disk caches, in logs and in arrays. The blocks of
  /// voxels have the first numbers, and the blocks of one voxel follow each other. The pages of textures are
  /// next, texture by texture. Numbers ascend as keys do. Requires: as block().
  uint32_t NumberOf(BlockKey key) const {
    if (key.kind() == BlockKind::kPage) return static_cast<uint32_t>(voxel_blocks()) + key.index();
    return key.index() * kVoxelBlocks + static_cast<uint32_t>(key.kind());
  }
  std::vector<uint32_t> NumbersOf(std::span<const BlockKey> keys) const;
  /// The block of a number, which may come from outside. Returns: nothing where the scene has no such block.
  std::optional<BlockKey> BlockOf(uint32_t number) const;
  /// Upper limit of block numbers: each is below it.
  size_t block_numbers() const { return voxel_blocks() + first_page.back(); }
  /// The number of the first page.
  size_t voxel_blocks() const { return voxels.size() * kVoxelBlocks; }
  /// Which page of which texture a block is, and the block of a page.
  uint32_t TextureOf(BlockKey page) const;
  uint32_t PageOf(BlockKey page) const { return page.index() - first_page[TextureOf(page)]; }
  BlockKey PageKey(uint32_t texture, uint32_t page) const {
    return BlockKey::Page(first_page[texture] + page);
  }
  /// Bytes of a cache that has room for all blocks.
  uint64_t DecodedBytes() const;
  TopTree top_tree() const {
    return {top_nodes.data(), chain_end.data(), bounds.data(),
            meta.root_lower,  meta.root_upper,  top_wide.data()};
  }
};

/// Whether nothing but shape tells the surfaces of a scene apart: no textures, no colours of vertices, and
/// one colour of all materials.
bool IsPlain(const Catalog& catalog);
/// Whether some triangles shine, so that a picture needs no other light. Triangles with a map of emission do
/// not count: such maps are mostly displays and small lamps. Where the store names no emitters, a material
/// tells.
bool Shines(const Catalog& catalog);

/// The box of the voxels of a leaf, within its cell. Voxels are left out where is_hidden(voxel) is true; a
/// leaf without voxels has its cell.
template <class IsHidden>
Box BoxOfVoxels(const Catalog& catalog, const KdNode& leaf, const Box& cell, const IsHidden& is_hidden) {
  if (leaf.count() == 0) return cell;
  Box8 around = Box8::Empty();
  for (uint32_t v = leaf.first(); v < catalog.chain_end[leaf.first()]; ++v) {
    if (is_hidden(v)) continue;
    const VoxelBounds& b = catalog.bounds[v];
    around.Include(Box8::Of({{b.lower[0], b.lower[1], b.lower[2]}, {b.upper[0], b.upper[1], b.upper[2]}}));
  }
  return around.Within(Box8::Of(cell)).box();
}

/// The bytes of a section, owned or not.
struct Section {
  SectionType type;
  Bytes bytes;
};
struct SectionView {
  SectionType type;
  std::span<const std::byte> bytes;
};

/// Encode a section; FORMAT.md gives the bytes.
Bytes EncodeMeta(const SceneMeta& meta);
Bytes EncodeTopTree(const std::vector<KdNode>& nodes);
Bytes EncodeDirectory(const std::vector<VoxelEntry>& voxels);
/// Bytes of a material in MATL, its name's offset first.
inline constexpr size_t kMaterialBytes = 4 + 136;
/// Appends a material's numbers, without its name and textures.
void PutMaterial(const Material& material, ByteWriter& out);
/// Reads a material's numbers; IsSane() must check them. Errors: unknown flags make in.ok() false.
Material GetMaterial(ByteReader& in);
/// Encodes the MATL section; appends the materials' names to `strings`.
Bytes EncodeMaterials(const std::vector<Material>& materials, std::string& strings);

/// The bytes [begin, end) of the file in which texture pages must lie.
struct TexturePlaces {
  uint64_t begin = 0, end = uint64_t{1} << 62;
};

/// Decodes a catalog from its sections and checks everything: kernels and caches rely on it. TEXD and MTEX
/// may be missing; other sections are ignored.
/// Errors: a missing section; a section of the wrong size; a link, offset, size or value out of range.
Result<Catalog> DecodeCatalog(const SceneId& id, const std::vector<SectionView>& sections,
                              const TexturePlaces& places = {});
Result<Catalog> DecodeCatalog(const SceneId& id, const std::vector<Section>& sections,
                              const TexturePlaces& places = {});

/// Packs sections into bytes for the network: type, size, checksum and content of each.
Bytes PackSections(const std::vector<Section>& sections);
/// The inverse of PackSections(), as views of `bytes`. Errors: cut short; a wrong checksum.
Result<std::vector<SectionView>> UnpackSections(std::span<const std::byte> bytes);

}  // namespace quarry
