#include "common/voxel/store_writer.h"

#include <xxhash.h>

#include <algorithm>
#include <cstring>

#include "common/base/check.h"
#include "common/voxel/emitters/emitter_section.h"
#include "common/voxel/texture_page.h"
#include "common/voxel/view_sections.h"

namespace quarry {
namespace {

constexpr uint32_t kSceneSections = 18, kEnvironmentSections = 19;

SceneId HashScene(const std::vector<uint64_t>& logical, const std::vector<WrittenTexture>& textures,
                  const std::vector<std::span<const std::byte>>& sections) {
  XXH3_state_t* state = XXH3_createState();
  XXH3_128bits_reset(state);
  XXH3_128bits_update(state, logical.data(), logical.size() * sizeof(uint64_t));
  for (const WrittenTexture& t : textures)
    XXH3_128bits_update(state, t.logical.data(), t.logical.size() * sizeof(uint64_t));
  for (const auto section : sections) XXH3_128bits_update(state, section.data(), section.size());
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(state));
  XXH3_freeState(state);
  SceneId id;
  std::memcpy(id.data(), canonical.digest, id.size());
  return id;
}

void PutSectionEntry(ByteWriter& out, SectionType type, uint32_t flags, uint64_t offset, uint64_t size,
                     uint64_t checksum) {
  out.Put(static_cast<uint32_t>(type));
  out.Put(flags);
  out.Put(offset);
  out.Put(size);
  out.Put(checksum);
  out.Put(uint64_t{0});
}

Bytes EncodeHeader(uint32_t version, uint32_t sections, const SceneId& id, uint64_t file_size,
                   std::span<const std::byte> table) {
  ByteWriter out;
  out.PutArray(kStoreMagic);
  out.Put(version);
  out.Put(sections);
  out.Put(file_size);
  out.Put(kStoreHeaderBytes);
  out.PutArray(id);
  out.Put(Checksum(table));
  out.Put(Checksum(out.bytes()));
  return out.Take();
}

Bytes EncodePartNames(const std::vector<std::string>& parts, std::string& strings) {
  ByteWriter out;
  for (const std::string& part : parts) {
    out.Put(static_cast<uint32_t>(strings.size()));
    strings.append(part).push_back('\0');
  }
  return out.Take();
}

Bytes EncodeModels(const std::vector<std::string>& models) {
  ByteWriter out;
  out.Put(static_cast<uint32_t>(models.size()));
  for (size_t i = 0; i < std::min(models.size(), kMostModelNames); ++i) {
    out.PutArray(std::string_view(models[i]).substr(0, kMostModelNameBytes));
    out.Put('\0');
  }
  return out.Take();
}

/// The part of the facts that enters the scene id: nothing that depends on the compressor.
SceneMeta LogicalMeta(SceneMeta meta) {
  meta.largest_stored = 0;
  meta.lz4_version = 0;
  return meta;
}

}  // namespace

EncodedVoxel EncodeVoxel(const HotVoxel& hot, const ShadingVoxel* shading) {
  EncodedVoxel voxel;
  Bytes streams = EncodeHot(hot);
  voxel.hot = CompressBlock(streams);
  voxel.hot_decoded =
      static_cast<uint32_t>(HotBytes(hot.wide_nodes, hot.references.size(), hot.triangle_ids.size(),
                                     hot.vertices.size(), hot.masks.size(), hot.fine_masks.size()));
  voxel.masks = !hot.masks.empty();
  voxel.hot_logical = Checksum(streams);
  voxel.parts = EncodePartList(hot.parts);
  if (shading) {
    voxel.colored = std::ranges::any_of(
        shading->vertices, [](const ShadingVertex& v) { return v.color != ShadingVertex().color; });
    streams = EncodeShading(*shading);
    voxel.shading = CompressBlock(streams);
    voxel.shading_decoded =
        static_cast<uint32_t>(ShadingBytes(shading->corners.size() / 3, shading->vertices.size()));
    voxel.shading_logical = Checksum(streams);
  }
  voxel.triangles = static_cast<uint32_t>(hot.triangle_ids.size());
  const Box bounds = BoundsOf(hot.vertices);
  voxel.bounds_lower = bounds.lower;
  voxel.bounds_upper = bounds.upper;
  return voxel;
}

EncodedPage EncodeTexturePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                              std::span<const std::byte> texels) {
  const Bytes streams = EncodePage(shape, layout, page, texels);
  return {CompressBlock(streams), static_cast<uint32_t>(texels.size()), Checksum(streams)};
}

Result<StoreWriter> StoreWriter::Create(const std::string& path) {
  QUARRY_ASSIGN(OutputFile file, OutputFile::Create(path));
  StoreWriter writer(std::move(file), kSceneSections);
  QUARRY_TRY(writer.PutRoom());
  return writer;
}

Result<StoreWriter> StoreWriter::CreateEnvironment(const std::string& path) {
  QUARRY_ASSIGN(OutputFile file, OutputFile::Create(path));
  StoreWriter writer(std::move(file), kEnvironmentSections);
  QUARRY_TRY(writer.PutRoom());
  return writer;
}

uint64_t StoreWriter::BlocksOffset() const { return kStoreHeaderBytes + sections_ * kSectionEntryBytes; }

/// Leaves room for the header and the section table.
Status StoreWriter::PutRoom() { return file_.Write(Bytes(BlocksOffset())); }

Result<StoreWriter> StoreWriter::Continue(const std::string& path, const std::string& temporary,
                                          StoreProgress progress) {
  QUARRY_ASSIGN(OutputFile file, OutputFile::Continue(path, temporary, progress.bytes));
  StoreWriter writer(std::move(file), kSceneSections);
  writer.directory_ = std::move(progress.directory);
  writer.logical_ = std::move(progress.logical);
  writer.parts_ = std::move(progress.parts);
  writer.textures_ = std::move(progress.textures);
  writer.masks_ = progress.masks;
  writer.colored_ = progress.colored;
  if (progress.bytes == 0) QUARRY_TRY(writer.PutRoom());
  return writer;
}

Status StoreWriter::AddVoxel(const EncodedVoxel& voxel) {
  VoxelEntry entry;
  entry.blocks[0] = {file_.size(), static_cast<uint32_t>(voxel.hot.size()), voxel.hot_decoded,
                     Checksum(voxel.hot)};
  entry.blocks[1] = {file_.size() + voxel.hot.size(), static_cast<uint32_t>(voxel.shading.size()),
                     voxel.shading_decoded, voxel.shading.empty() ? 0 : Checksum(voxel.shading)};
  entry.triangles = voxel.triangles;
  entry.bounds_lower = voxel.bounds_lower;
  entry.bounds_upper = voxel.bounds_upper;
  if (voxel.chained) entry.next_in_chain = voxel_count() + 1;
  directory_.push_back(entry);
  masks_ = masks_ || voxel.masks;
  colored_ = colored_ || voxel.colored;
  logical_.push_back(voxel.hot_logical);
  logical_.push_back(voxel.shading_logical);
  parts_.sizes.push_back(static_cast<uint32_t>(voxel.parts.size()));
  parts_.bytes.insert(parts_.bytes.end(), voxel.parts.begin(), voxel.parts.end());
  QUARRY_TRY(file_.Write(voxel.hot));
  return file_.Write(voxel.shading);
}

void StoreWriter::BeginTexture(std::string name, const TexelLayout& layout) {
  const uint32_t pages = TextureShape(layout.width, layout.height).pages();
  texture_begin_ = file_.size();
  textures_.push_back(
      {{std::move(name), layout, std::vector<BlockEntry>(pages)}, std::vector<uint64_t>(pages)});
}

Status StoreWriter::AddPage(uint32_t page, const EncodedPage& encoded) {
  WrittenTexture& t = textures_.back();
  QUARRY_CHECK_EQ(t.texture.pages[page].stored, 0u);
  t.texture.pages[page] = {file_.size(), static_cast<uint32_t>(encoded.stored.size()), encoded.decoded,
                           Checksum(encoded.stored)};
  t.logical[page] = encoded.logical;
  return file_.Write(encoded.stored);
}

Status StoreWriter::DropTexture() {
  textures_.pop_back();
  return file_.Shorten(texture_begin_);
}

Result<SceneId> StoreWriter::Finish(SceneMeta meta, const std::vector<KdNode>& top_nodes,
                                    const std::vector<Material>& materials, const PartTable& parts,
                                    const SceneViews& views, const std::vector<std::string>& models) {
  QUARRY_CHECK_EQ(parts.facts.size(), parts.names.size());
  QUARRY_CHECK_EQ(sections_, sky_ ? kEnvironmentSections : kSceneSections);
  for (const VoxelEntry& v : directory_) {
    for (const BlockEntry& b : v.blocks) {
      meta.largest_decoded = std::max(meta.largest_decoded, b.decoded);
      meta.largest_stored = std::max(meta.largest_stored, b.stored);
    }
    meta.stored_references += v.triangles;
  }
  meta.lz4_version = CompressorVersion();
  meta.masks = masks_;
  meta.uncolored = !colored_;
  uint64_t blocks_end = BlocksOffset();
  if (!directory_.empty()) {
    const auto& [hot, shading] = directory_.back().blocks;
    blocks_end = hot.offset + hot.stored + shading.stored;
  }
  const uint64_t pages_size = file_.size() - blocks_end;
  std::vector<Texture> textures;
  for (const WrittenTexture& t : textures_) textures.push_back(t.texture);

  std::string strings;
  std::vector<Section> sections;
  sections.push_back({SectionType::kMeta, EncodeMeta(meta)});
  sections.push_back({SectionType::kTopTree, EncodeTopTree(top_nodes)});
  sections.push_back({SectionType::kDirectory, EncodeDirectory(directory_)});
  sections.push_back({SectionType::kMaterials, EncodeMaterials(materials, strings)});
  sections.push_back({SectionType::kParts, EncodePartNames(parts.names, strings)});
  Bytes texture_directory = EncodeTextures(textures, strings);
  Bytes cameras = EncodeCameras(views.cameras, strings), lights = EncodeLights(views.lights, strings);
  const auto text = AsBytes(strings);
  sections.push_back({SectionType::kStrings, Bytes(text.begin(), text.end())});
  sections.push_back({SectionType::kTextureDirectory, std::move(texture_directory)});
  sections.push_back({SectionType::kMaterialTextures, EncodeMaterialTextures(materials)});
  sections.push_back({SectionType::kCameras, std::move(cameras)});
  sections.push_back({SectionType::kLights, std::move(lights)});
  sections.push_back({SectionType::kPartTree, EncodePartTree(parts.facts)});
  sections.push_back({SectionType::kVoxelParts, parts_.bytes});
  sections.push_back({SectionType::kPartAttributes, EncodePartAttributes(parts.attributes)});
  EmitterSections emitters = EncodeEmitters(emitters_, materials);
  sections.push_back({SectionType::kEmitters, std::move(emitters.plain)});
  sections.push_back({SectionType::kMappedEmitters, std::move(emitters.mapped)});
  if (sky_) sections.push_back({SectionType::kEnvironment, sky_->Encode()});

  const Bytes facts = EncodeMeta(LogicalMeta(meta)), texture_facts = EncodeTextureFacts(textures);
  std::vector<std::span<const std::byte>> logical;
  for (const Section& s : sections) {
    if (s.type == SectionType::kDirectory) continue;  // positions and sizes of compressed blocks
    logical.emplace_back(s.type == SectionType::kMeta               ? facts
                         : s.type == SectionType::kTextureDirectory ? texture_facts
                                                                    : s.bytes);
  }
  const SceneId id = HashScene(logical_, textures_, logical);
  sections.push_back({SectionType::kModels, EncodeModels(models)});  // a renamed model is the same scene

  ByteWriter table;
  PutSectionEntry(table, SectionType::kBlocks, kSectionCritical | kSectionOwnChecksums, BlocksOffset(),
                  blocks_end - BlocksOffset(), 0);
  PutSectionEntry(table, SectionType::kTexturePages, kSectionOwnChecksums, blocks_end, pages_size, 0);
  for (const Section& s : sections) {
    // Readers may ignore names, textures and views.
    const bool critical = &s < &sections[4] || s.type == SectionType::kEnvironment;
    PutSectionEntry(table, s.type, critical ? kSectionCritical : 0, file_.size(), s.bytes.size(),
                    Checksum(s.bytes));
    QUARRY_TRY(file_.Write(s.bytes));
  }
  QUARRY_TRY(file_.WriteAt(
      0, EncodeHeader(masks_ ? kStoreVersion : version_, sections_, id, file_.size(), table.bytes())));
  QUARRY_TRY(file_.WriteAt(kStoreHeaderBytes, table.bytes()));
  QUARRY_TRY(file_.Commit());
  return id;
}

}  // namespace quarry
