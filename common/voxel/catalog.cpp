// Long: a function that encodes and one that decodes each section of the catalog.
#include "common/voxel/catalog.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "common/kdtree/build/box8.h"
#include "common/kdtree/build/treelets.h"
#include "common/kdtree/build/wide_tree.h"
#include "common/scene/open_pbr.h"
#include "common/voxel/emitters/emitter_section.h"
#include "common/voxel/environment/sky_section.h"
#include "common/voxel/texture_sections.h"

namespace quarry {
namespace {

constexpr size_t kMetaBytes = 192;
constexpr uint32_t kMasksFlag = 1, kUncoloredFlag = 2;  // of META
constexpr size_t kVoxelBytes = 72;
// Flags of a material. The last two say which form the file gave; earlier versions wrote neither.
constexpr uint32_t kFresnelFlag = 1, kUnlitFlag = 2, kOpenPbrFlag = 4, kWeightsFlag = 8, kMaterialFlags = 15;
/// Laid out in treelets, two nodes take at most nine slots with headers and alignment, and links number
/// slots.
constexpr size_t kMostTopNodes = KdNode::kMaxLink / 5;

const SectionView* Find(const std::vector<SectionView>& sections, SectionType type) {
  for (const SectionView& s : sections)
    if (s.type == type) return &s;
  return nullptr;
}

bool Finite(const glm::vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

Result<SceneMeta> DecodeMeta(std::span<const std::byte> bytes) {
  ByteReader in(bytes);
  SceneMeta m;
  m.bounds_lower = in.GetVec3<glm::vec3>();
  m.bounds_upper = in.GetVec3<glm::vec3>();
  m.root_lower = in.GetVec3<glm::vec3>();
  m.root_upper = in.GetVec3<glm::vec3>();
  m.padding = in.Get<float>();
  m.up_axis = in.Get<uint32_t>();
  m.offset = in.GetVec3<glm::dvec3>();
  m.unit_in_metres = in.Get<double>();
  m.input_triangles = in.Get<uint64_t>();
  m.dropped_degenerate = in.Get<uint64_t>();
  m.dropped_not_finite = in.Get<uint64_t>();
  m.stored_references = in.Get<uint64_t>();
  m.voxel_size = in.Get<uint32_t>();
  m.largest_decoded = in.Get<uint32_t>();
  m.largest_stored = in.Get<uint32_t>();
  m.lz4_version = in.Get<uint32_t>();
  m.dropped_transparent = in.Get<uint64_t>();
  const auto flags = in.Get<uint32_t>();
  m.masks = (flags & kMasksFlag) != 0;
  m.uncolored = (flags & kUncoloredFlag) != 0;
  if (!in.ok() || bytes.size() != kMetaBytes) return Fail("the META section has the wrong size");
  if (!Finite(m.root_lower) || !Finite(m.root_upper) || !std::isfinite(m.padding) || m.padding < 0 ||
      m.up_axis > 2 || m.largest_decoded > kMaxBlockBytes)
    return Fail("the META section holds invalid values");
  return m;
}

Status DecodeTopTree(std::span<const std::byte> bytes, Catalog& catalog) {
  if (bytes.empty() || bytes.size() % sizeof(KdNode) != 0 || bytes.size() / sizeof(KdNode) > kMostTopNodes)
    return Fail("the TOPT section has the wrong size");
  const std::vector<KdNode> nodes = ByteReader(bytes).GetArray<KdNode>(bytes.size() / sizeof(KdNode));
  // Each node but the root must be the child of exactly one earlier node: the tree has no cycle and is
  // complete.
  std::vector<bool> has_parent(nodes.size());
  std::vector<uint8_t> level(nodes.size());
  // Each voxel is in at most one leaf: named by it, or in a chain that begins with a named voxel.
  std::vector<bool> in_leaf(catalog.voxels.size());
  for (size_t v = 0; v + 1 < catalog.voxels.size(); ++v)
    if (catalog.voxels[v].next_in_chain != kNoIndex) in_leaf[v + 1] = true;
  for (size_t i = 0; i < nodes.size(); ++i) {
    const KdNode& n = nodes[i];
    bool valid = (i == 0 || has_parent[i]) && (n.link & KdNode::kFlags) == 0;
    if (n.is_leaf()) {
      valid = valid && (n.count() == 0 ||
                        (n.count() == 1 && n.first() < catalog.voxels.size() && !in_leaf[n.first()]));
      if (valid && n.count() == 1) in_leaf[n.first()] = true;
    } else {
      const size_t left = n.left();
      valid = valid && left > i && left + 1 < nodes.size() && std::isfinite(n.split()) && !has_parent[left] &&
              !has_parent[left + 1];
      if (valid && level[i] == kMostLevels)
        return Fail(fmt::format("the TOPT section's tree has more than {} levels", kMostLevels));
      if (valid) {
        has_parent[left] = has_parent[left + 1] = true;
        level[left] = level[left + 1] = static_cast<uint8_t>(level[i] + 1);
      }
    }
    if (!valid) return Fail(fmt::format("the TOPT section's node {} leads nowhere", i));
  }
  catalog.top_node_count = static_cast<uint32_t>(nodes.size());
  const Box box{catalog.meta.root_lower, catalog.meta.root_upper};
  catalog.top_wide = MakeWideTree(nodes, box, 0, [&](const KdNode& leaf, const Box& cell) {
    return BoxOfVoxels(catalog, leaf, cell, [](uint32_t) { return false; });
  });
  catalog.top_nodes = LayOutTreelets(nodes, kTreeletLevels, box);
  return {};
}

Status CheckVoxel(const VoxelEntry& v, size_t index, size_t count, const SceneMeta& meta) {
  for (const BlockEntry& b : v.blocks)
    if (b.decoded > meta.largest_decoded || b.stored > meta.largest_stored ||
        b.stored > MostStored(b.decoded) || (b.stored == 0) != (b.decoded == 0) ||
        b.offset > uint64_t{1} << 62)
      return Fail(fmt::format("the VDIR section's voxel {} has an invalid size or place", index));
  if (v.blocks[0].stored == 0) return Fail(fmt::format("the VDIR section's voxel {} is empty", index));
  if (v.next_in_chain != kNoIndex && (v.next_in_chain != index + 1 || v.next_in_chain >= count))
    return Fail(fmt::format("the VDIR section's voxel {} continues in an invalid voxel", index));
  for (int a = 0; a < 3; ++a)
    if (!(v.bounds_lower[a] <= v.bounds_upper[a]) || !(v.bounds_lower[a] >= meta.root_lower[a]) ||
        !(v.bounds_upper[a] <= meta.root_upper[a]))
      return Fail(fmt::format("the VDIR section's voxel {} lies at an invalid place", index));
  return {};
}

Status DecodeDirectory(std::span<const std::byte> bytes, Catalog& catalog) {
  const size_t count = bytes.size() / kVoxelBytes;
  if (bytes.size() % kVoxelBytes != 0 || count > 0x7FFFFFFF)
    return Fail("the VDIR section has the wrong size");
  ByteReader in(bytes);
  catalog.voxels.resize(count);
  catalog.chain_end.resize(count);
  catalog.bounds.resize(count);
  for (size_t i = 0; i < count; ++i) {
    VoxelEntry& v = catalog.voxels[i];
    v.blocks[0].offset = in.Get<uint64_t>();
    for (BlockEntry& b : v.blocks) {
      b.stored = in.Get<uint32_t>();
      b.decoded = in.Get<uint32_t>();
      b.checksum = in.Get<uint64_t>();
    }
    v.blocks[1].offset = v.blocks[0].offset + v.blocks[0].stored;
    v.triangles = in.Get<uint32_t>();
    v.next_in_chain = in.Get<uint32_t>();
    v.bounds_lower = in.GetVec3<glm::vec3>();
    v.bounds_upper = in.GetVec3<glm::vec3>();
    QUARRY_TRY(CheckVoxel(v, i, count, catalog.meta));
    for (int a = 0; a < 3; ++a) {
      catalog.bounds[i].lower[a] = v.bounds_lower[a] - catalog.meta.padding;
      catalog.bounds[i].upper[a] = v.bounds_upper[a] + catalog.meta.padding;
    }
  }
  for (size_t i = count; i-- > 0;)
    catalog.chain_end[i] =
        catalog.voxels[i].next_in_chain != kNoIndex ? catalog.chain_end[i + 1] : static_cast<uint32_t>(i) + 1;
  return {};
}

Status DecodeMaterials(std::span<const std::byte> bytes, Catalog& catalog) {
  ByteReader in(bytes);
  const auto count = in.Get<uint32_t>();
  if (!in.ok() || count > 65536 || in.remaining() != count * kMaterialBytes)
    return Fail("the MATL section has the wrong size");
  catalog.materials.resize(count);
  for (size_t i = 0; i < catalog.materials.size(); ++i) {
    in.Get<uint32_t>();  // offset of the name in STRS
    catalog.materials[i] = GetMaterial(in);
    if (!in.ok() || !IsSane(catalog.materials[i]))
      return Fail(fmt::format("the MATL section's material {} holds invalid values", i));
  }
  return {};
}

/// Adds the textures, and the materials' uses of them.
Status DecodeTexturing(const std::vector<SectionView>& sections, const TexturePlaces& places,
                       Catalog& catalog) {
  if (const SectionView* directory = Find(sections, SectionType::kTextureDirectory)) {
    QUARRY_ASSIGN(catalog.textures, DecodeTextures(directory->bytes, places.begin, places.end));
  }
  for (const Texture& texture : catalog.textures) {
    catalog.shapes.emplace_back(texture.layout.width, texture.layout.height);
    catalog.first_page.push_back(catalog.first_page.back() + catalog.shapes.back().pages());
    for (const BlockEntry& page : texture.pages) {
      catalog.meta.largest_decoded = std::max(catalog.meta.largest_decoded, PageRoom(page.decoded));
      catalog.meta.largest_stored = std::max(catalog.meta.largest_stored, page.stored);
    }
  }
  if (catalog.block_numbers() > UINT32_MAX) return Fail("the scene has too many blocks");
  const SectionView* uses = Find(sections, SectionType::kMaterialTextures);
  if (!uses) return {};
  QUARRY_ASSIGN(const auto bindings,
                DecodeMaterialTextures(uses->bytes, catalog.materials.size(), catalog.textures.size()));
  for (const MaterialTexture& use : bindings) catalog.materials[use.material].textures.push_back(use.binding);
  return {};
}

}  // namespace

uint32_t Catalog::TextureOf(BlockKey page) const {
  return static_cast<uint32_t>(std::ranges::upper_bound(first_page, page.index()) - first_page.begin()) - 1;
}

std::vector<uint32_t> Catalog::NumbersOf(std::span<const BlockKey> keys) const {
  std::vector<uint32_t> numbers;
  numbers.reserve(keys.size());
  for (const BlockKey key : keys) numbers.push_back(NumberOf(key));
  return numbers;
}

std::optional<BlockKey> Catalog::BlockOf(uint32_t number) const {
  const size_t pages = voxel_blocks();
  const BlockKey key = number < pages
                           ? BlockKey(static_cast<BlockKind>(number % kVoxelBlocks), number / kVoxelBlocks)
                           : BlockKey::Page(static_cast<uint32_t>(number - pages));
  return Has(key) ? std::optional(key) : std::nullopt;
}

uint64_t Catalog::DecodedBytes() const {
  uint64_t bytes = 0;
  for (const VoxelEntry& voxel : voxels)
    for (const BlockEntry& block : voxel.blocks) bytes += block.decoded;
  for (const Texture& texture : textures)
    for (const BlockEntry& page : texture.pages) bytes += PageRoom(page.decoded);
  return bytes;
}

bool Shines(const Catalog& catalog) {
  if (catalog.names_emitters)
    return std::ranges::any_of(catalog.emitters, [&](const Emitter& emitter) {
      return !EmissionMapOf(catalog.materials[emitter.material]);
    });
  return std::ranges::any_of(catalog.materials,
                             [](const Material& m) { return !m.unlit && m.emission != glm::vec3(0); });
}

bool IsPlain(const Catalog& catalog) {
  const auto& materials = catalog.materials;
  return catalog.meta.uncolored && catalog.textures.empty() &&
         std::ranges::all_of(materials,
                             [&](const Material& m) { return m.base_color == materials.front().base_color; });
}

std::string FormatSceneId(const SceneId& id) {
  std::string text;
  for (uint8_t byte : id) text += fmt::format("{:02x}", byte);
  return text;
}

Result<SceneId> ParseSceneId(std::string_view text) {
  SceneId id{};
  if (text.size() != 2 * id.size()) return Fail(fmt::format("'{}' is not a scene id", text));
  for (size_t i = 0; i < id.size(); ++i) {
    const auto [end, error] = std::from_chars(text.data() + 2 * i, text.data() + 2 * i + 2, id[i], 16);
    if (error != std::errc() || end != text.data() + 2 * i + 2)
      return Fail(fmt::format("'{}' is not a scene id", text));
  }
  return id;
}

Bytes EncodeMeta(const SceneMeta& m) {
  ByteWriter out;
  out.PutVec3(m.bounds_lower);
  out.PutVec3(m.bounds_upper);
  out.PutVec3(m.root_lower);
  out.PutVec3(m.root_upper);
  out.Put(m.padding);
  out.Put(m.up_axis);
  out.PutVec3(m.offset);
  out.Put(m.unit_in_metres);
  out.Put(m.input_triangles);
  out.Put(m.dropped_degenerate);
  out.Put(m.dropped_not_finite);
  out.Put(m.stored_references);
  out.Put(m.voxel_size);
  out.Put(m.largest_decoded);
  out.Put(m.largest_stored);
  out.Put(m.lz4_version);
  out.Put(m.dropped_transparent);
  out.Put((m.masks ? kMasksFlag : 0u) | (m.uncolored ? kUncoloredFlag : 0u));
  Bytes bytes = out.Take();
  bytes.resize(kMetaBytes);
  return bytes;
}

Bytes EncodeTopTree(const std::vector<KdNode>& nodes) {
  ByteWriter out;
  out.PutArray(nodes);
  return out.Take();
}

Bytes EncodeDirectory(const std::vector<VoxelEntry>& voxels) {
  ByteWriter out;
  for (const VoxelEntry& v : voxels) {
    out.Put(v.blocks[0].offset);
    for (const BlockEntry& b : v.blocks) {
      out.Put(b.stored);
      out.Put(b.decoded);
      out.Put(b.checksum);
    }
    out.Put(v.triangles);
    out.Put(v.next_in_chain);
    out.PutVec3(v.bounds_lower);
    out.PutVec3(v.bounds_upper);
  }
  return out.Take();
}

void PutMaterial(const Material& m, ByteWriter& out) {
  for (const glm::vec3* color : {&m.diffuse, &m.specular, &m.emission, &m.reflectance, &m.transmittance})
    out.PutVec3(*color);
  out.Put(m.shininess);
  out.Put(m.ior);
  out.Put((m.fresnel ? kFresnelFlag : 0u) | (m.unlit ? kUnlitFlag : 0u) |
          (m.is_open_pbr ? kOpenPbrFlag : kWeightsFlag));
  for (const glm::vec3* color : {&m.base_color, &m.specular_color, &m.transmission_color})
    out.PutVec3(*color);
  for (const float x : {m.base_metalness, m.specular_roughness, m.specular_weight, m.specular_ior,
                        m.transmission_weight, m.transmission_depth, m.geometry_opacity})
    out.Put(x);
}

Material GetMaterial(ByteReader& in) {
  Material m;
  for (glm::vec3* color : {&m.diffuse, &m.specular, &m.emission, &m.reflectance, &m.transmittance})
    *color = in.GetVec3<glm::vec3>();
  m.shininess = in.Get<float>();
  m.ior = in.Get<float>();
  const auto flags = in.Get<uint32_t>();
  m.fresnel = (flags & kFresnelFlag) != 0;
  m.unlit = (flags & kUnlitFlag) != 0;
  for (glm::vec3* color : {&m.base_color, &m.specular_color, &m.transmission_color})
    *color = in.GetVec3<glm::vec3>();
  for (float* x : {&m.base_metalness, &m.specular_roughness, &m.specular_weight, &m.specular_ior,
                   &m.transmission_weight, &m.transmission_depth, &m.geometry_opacity})
    *x = in.Get<float>();
  const uint32_t form = flags & (kOpenPbrFlag | kWeightsFlag);
  m.is_open_pbr = form != 0 ? form == kOpenPbrFlag : AgreesWithOpenPbr(m);
  if ((flags & ~kMaterialFlags) != 0 || form == (kOpenPbrFlag | kWeightsFlag)) in.GetSpan(~uint64_t{0});
  return m;
}

Bytes EncodeMaterials(const std::vector<Material>& materials, std::string& strings) {
  ByteWriter out;
  out.Put(static_cast<uint32_t>(materials.size()));
  for (const Material& m : materials) {
    out.Put(static_cast<uint32_t>(strings.size()));
    strings.append(m.name).push_back('\0');
    PutMaterial(m, out);
  }
  return out.Take();
}

Result<Catalog> DecodeCatalog(const SceneId& id, const std::vector<Section>& sections,
                              const TexturePlaces& places) {
  std::vector<SectionView> views;
  for (const Section& s : sections) views.push_back({s.type, s.bytes});
  return DecodeCatalog(id, views, places);
}

Result<Catalog> DecodeCatalog(const SceneId& id, const std::vector<SectionView>& sections,
                              const TexturePlaces& places) {
  const SectionType needed[] = {SectionType::kMeta, SectionType::kDirectory, SectionType::kTopTree,
                                SectionType::kMaterials};
  for (SectionType type : needed)
    if (!Find(sections, type)) return Fail("a section that every scene needs is missing");
  Catalog catalog;
  catalog.id = id;
  QUARRY_ASSIGN(catalog.meta, DecodeMeta(Find(sections, SectionType::kMeta)->bytes));
  QUARRY_TRY(DecodeDirectory(Find(sections, SectionType::kDirectory)->bytes, catalog));
  QUARRY_TRY(DecodeTopTree(Find(sections, SectionType::kTopTree)->bytes, catalog));
  QUARRY_TRY(DecodeMaterials(Find(sections, SectionType::kMaterials)->bytes, catalog));
  QUARRY_TRY(DecodeTexturing(sections, places, catalog));
  if (const SectionView* emitters = Find(sections, SectionType::kEmitters)) {
    const SectionView* mapped = Find(sections, SectionType::kMappedEmitters);
    const std::span<const std::byte> none;
    QUARRY_ASSIGN(catalog.emitters, DecodeEmitters(emitters->bytes, mapped ? mapped->bytes : none, catalog));
    catalog.names_emitters = true;
  }
  if (const SectionView* sky = Find(sections, SectionType::kEnvironment))
    QUARRY_TRY(DecodeSky(sky->bytes, catalog));
  return catalog;
}

Bytes PackSections(const std::vector<Section>& sections) {
  ByteWriter out;
  for (const Section& s : sections) {
    out.Put(static_cast<uint32_t>(s.type));
    out.Put(static_cast<uint64_t>(s.bytes.size()));
    out.Put(Checksum(s.bytes));
    out.PutArray(s.bytes);
  }
  return out.Take();
}

Result<std::vector<SectionView>> UnpackSections(std::span<const std::byte> bytes) {
  std::vector<SectionView> sections;
  ByteReader in(bytes);
  while (in.remaining() > 0) {
    const auto type = static_cast<SectionType>(in.Get<uint32_t>());
    const auto size = in.Get<uint64_t>();
    const auto checksum = in.Get<uint64_t>();
    const auto content = in.GetSpan(size);
    if (!in.ok()) return Fail("the scene's catalog is cut short");
    if (Checksum(content) != checksum) return Fail("the scene's catalog is damaged (checksum)");
    sections.push_back({type, content});
  }
  return sections;
}

}  // namespace quarry
