#include "tests/laboratory/scene.h"

#include <algorithm>

#include "common/voxel/block_decoder.h"

namespace quarry::laboratory {

namespace {

/// Memory for decoded blocks, aligned as decoders ask.
struct alignas(64) Aligned {
  std::byte bytes[64];
};

std::span<std::byte> Fit(std::vector<Aligned>& memory, size_t bytes) {
  memory.resize((bytes + sizeof(Aligned) - 1) / sizeof(Aligned));
  return {memory.data()->bytes, bytes};
}

}  // namespace

Result<std::unique_ptr<LaboratoryScene>> LaboratoryScene::Load(const std::string& path) {
  auto scene = std::make_unique<LaboratoryScene>();
  QUARRY_ASSIGN(StoreReader store, StoreReader::Open(path));
  scene->store_ = std::make_unique<StoreReader>(std::move(store));
  const Catalog& catalog = scene->catalog();
  if (catalog.meta.masks || !catalog.textures.empty())
    return Fail(path +
                ": the store has textures, and the machine of the papers has none: make it with "
                "quarry-preprocess --no-textures");
  struct Place {
    uint32_t id, at;
  };
  std::vector<Place> places;
  std::vector<KdTriangle> triangles;
  std::vector<TriangleMaterial> materials;
  std::vector<TriangleAttributes> attributes;
  bool has_attributes = false;
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v) has_attributes |= catalog.Has(BlockKey::Shading(v));
  BlockDecoder decoder;
  std::vector<Aligned> hot_memory, shading_memory;
  std::vector<bool> seen;
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v) {
    const BlockKey hot_key = BlockKey::Hot(v), shading_key = BlockKey::Shading(v);
    QUARRY_ASSIGN(const Bytes hot_bytes, scene->store_->ReadBlock(hot_key));
    QUARRY_ASSIGN(const VoxelGeometry hot,
                  DecodeHot(decoder, catalog, v, hot_bytes, Fit(hot_memory, catalog.block(hot_key).decoded)));
    VoxelShading shading;
    if (catalog.Has(shading_key)) {
      QUARRY_ASSIGN(const Bytes bytes, scene->store_->ReadBlock(shading_key));
      QUARRY_ASSIGN(shading, DecodeShading(decoder, catalog, v, bytes,
                                           Fit(shading_memory, catalog.block(shading_key).decoded)));
    }
    for (uint32_t t = 0; t < hot.triangle_count; ++t) {
      const uint32_t id = hot.triangle_ids[t];
      if (id >= seen.size()) seen.resize(size_t{id} + 1 + seen.size() / 2);
      if (seen[id]) continue;
      seen[id] = true;
      places.push_back({id, static_cast<uint32_t>(places.size())});
      triangles.push_back({{hot.vertex(t, 0), hot.vertex(t, 1), hot.vertex(t, 2)}});
      materials.push_back(TriangleMaterial::Of(hot.materials[t], shading.vertices != nullptr));
      if (!has_attributes) continue;
      TriangleAttributes& own = attributes.emplace_back();
      if (shading.vertices)
        for (int c = 0; c < 3; ++c) own.vertices[c] = shading.vertex(t, c);
    }
  }
  std::ranges::sort(places, {}, &Place::id);
  for (const Place& place : places) {
    const KdTriangle& triangle = triangles[place.at];
    scene->triangles_.push_back(triangle);
    scene->materials_.push_back(materials[place.at]);
    if (has_attributes) scene->attributes_.push_back(attributes[place.at]);
    for (int c = 0; c < 3; ++c)
      scene->corners_[c].push_back({triangle.vertices[c].x, triangle.vertices[c].y, triangle.vertices[c].z});
  }
  for (int c = 0; c < 3; ++c)
    scene->corner_[c] = scene->addresses_.TextureOf(scene->corners_[c], DataKind::kTriangles);
  scene->material_ = scene->addresses_.TextureOf(scene->materials_, DataKind::kShading);
  scene->attribute_ = scene->addresses_.TextureOf(scene->attributes_, DataKind::kShading);
  return scene;
}

}  // namespace quarry::laboratory
