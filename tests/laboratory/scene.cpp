#include "tests/laboratory/scene.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/size.h"
#include "common/kdtree/ray.h"
#include "common/voxel/block_decoder.h"

namespace quarry::laboratory {

namespace {

bool HasAttributes(const Catalog& catalog) {
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v)
    if (catalog.Has(BlockKey::Shading(v))) return true;
  return false;
}

/// Keeps the elements that `kept` marks, in their order.
template <class T>
void Compact(std::vector<T>& data, const std::vector<bool>& kept) {
  size_t count = 0;
  for (size_t i = 0; i < data.size(); ++i)
    if (kept[i]) data[count++] = data[i];
  data.resize(count);
}

}  // namespace

uint32_t LaboratoryScene::PlaceOf(uint32_t id) const {
  return static_cast<uint32_t>(std::ranges::lower_bound(ids_, id) - ids_.begin());
}

uint64_t LaboratoryScene::BytesPerTriangle(bool attributes) {
  return sizeof(uint32_t) + sizeof(KdTriangle) + 3 * sizeof(Float3) + sizeof(TriangleMaterial) +
         (attributes ? sizeof(TriangleAttributes) : 0);
}

Status CheckMemory(const std::string& store, const Catalog& catalog, const MemoryNeeds& needs) {
  const uint64_t triangles = catalog.meta.input_triangles;
  // Ids have 32 bits.
  if (triangles > kNoTriangle)
    return Fail(fmt::format("{}: damaged: it claims {} triangles", store, triangles));
  const double scene = static_cast<double>(triangles) *
                           static_cast<double>(LaboratoryScene::BytesPerTriangle(HasAttributes(catalog)) +
                                               needs.structure_bytes) +
                       static_cast<double>(needs.cells * kCellBytes);
  const double pictures = static_cast<double>(needs.pixels) * static_cast<double>(needs.bytes_per_pixel);
  const double all = scene + std::max(pictures, needs.twice ? scene : 0);
  if (all <= static_cast<double>(needs.limit)) return {};
  const char* remedy = needs.pixels == 0 ? "" : " or a smaller --size";
  if (needs.twice && scene > pictures) remedy = ", or --no-instructions and --no-check, which need it once";
  const std::string picture =
      needs.pixels == 0 ? "" : fmt::format(" and a picture of {} pixels", needs.pixels);
  return Fail(fmt::format(
      "{}: {} triangles{} take about {} of memory, and there is {}: take a smaller model{}", store, triangles,
      picture, FormatSize(static_cast<uint64_t>(std::min(all, 0x1p62))), FormatSize(needs.limit), remedy));
}

Status LaboratoryScene::Check(const std::string& store, const Catalog& catalog, const MemoryNeeds& needs) {
  if (catalog.meta.masks || !catalog.textures.empty())
    return Fail(store +
                ": the store has textures, and the machine of the papers has none: make it with "
                "quarry-preprocess --no-textures");
  return CheckMemory(store, catalog, needs);
}

Result<std::unique_ptr<LaboratoryScene>> LaboratoryScene::Load(const std::string& path,
                                                               const MemoryNeeds& needs) {
  auto scene = std::make_unique<LaboratoryScene>();
  QUARRY_ASSIGN(StoreReader store, StoreReader::Open(path));
  scene->store_ = std::make_unique<StoreReader>(std::move(store));
  const Catalog& catalog = scene->catalog();
  QUARRY_TRY(Check(path, catalog, needs));
  QUARRY_TRY(scene->ReadTriangles());
  for (int c = 0; c < 3; ++c)
    scene->corners_.corner[c] = scene->addresses_.TextureOf(scene->corner_data_[c], DataKind::kTriangles);
  scene->corners_.count = static_cast<uint32_t>(scene->triangles_.size());
  scene->material_ = scene->addresses_.TextureOf(scene->materials_, DataKind::kShading);
  scene->attribute_ = scene->addresses_.TextureOf(scene->attributes_, DataKind::kShading);
  return scene;
}

Status LaboratoryScene::ReadTriangles() {
  const Catalog& catalog = this->catalog();
  // Each triangle goes to the place of its id. Places that stay empty are taken out afterwards.
  const uint64_t ids = catalog.meta.input_triangles;
  std::vector<bool> seen(ids);
  triangles_.resize(ids);
  for (auto& corners : corner_data_) corners.resize(ids);
  materials_.resize(ids);
  if (HasAttributes(catalog)) attributes_.resize(ids);
  BlockDecoder decoder;
  BlockMemory hot_memory, shading_memory;
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v) {
    const BlockKey hot_key = BlockKey::Hot(v), shading_key = BlockKey::Shading(v);
    QUARRY_ASSIGN(const Bytes hot_bytes, store_->ReadBlock(hot_key));
    QUARRY_ASSIGN(const VoxelGeometry hot,
                  DecodeHot(decoder, catalog, v, hot_bytes, hot_memory.Fit(catalog.block(hot_key).decoded)));
    VoxelShading shading;
    if (catalog.Has(shading_key)) {
      QUARRY_ASSIGN(const Bytes bytes, store_->ReadBlock(shading_key));
      QUARRY_ASSIGN(shading, DecodeShading(decoder, catalog, v, bytes,
                                           shading_memory.Fit(catalog.block(shading_key).decoded)));
    }
    for (uint32_t t = 0; t < hot.triangle_count; ++t) {
      const uint32_t id = hot.triangle_ids[t];
      if (id >= ids)
        return Fail(fmt::format("{}: damaged: voxel {} has triangle {} of {}", store_->path(), v, id, ids));
      if (seen[id]) continue;
      seen[id] = true;
      for (int c = 0; c < 3; ++c) {
        const glm::vec3& p = triangles_[id].vertices[c] = hot.vertex(t, c);
        corner_data_[c][id] = {p.x, p.y, p.z};
        if (shading.vertices) attributes_[id].vertices[c] = shading.vertex(t, c);
      }
      materials_[id] = TriangleMaterial::Of(hot.materials[t], shading.vertices != nullptr);
    }
  }
  for (uint32_t id = 0; id < ids; ++id)
    if (seen[id]) ids_.push_back(id);
  Compact(triangles_, seen);
  for (auto& corners : corner_data_) Compact(corners, seen);
  Compact(materials_, seen);
  Compact(attributes_, seen);
  return {};
}

}  // namespace quarry::laboratory
