#include "common/voxel/store_description.h"

#include <nlohmann/json.hpp>

#include "common/scene/scene_summary.h"

namespace quarry {
namespace {

nlohmann::ordered_json DescribeTexture(const Texture& texture) {
  const char* const formats[] = {"srgb8", "linear8", "half"};
  uint64_t stored = 0, decoded = 0;
  for (const BlockEntry& page : texture.pages) {
    stored += page.stored;
    decoded += page.decoded;
  }
  return {{"name", texture.name},
          {"width", texture.layout.width},
          {"height", texture.layout.height},
          {"channels", texture.layout.channels},
          {"format", formats[static_cast<size_t>(texture.layout.format)]},
          {"pages", texture.pages.size()},
          {"levels", TextureShape(texture.layout.width, texture.layout.height).levels().size()},
          {"stored_bytes", stored},
          {"decoded_bytes", decoded},
          {"uses", nlohmann::ordered_json::array()}};
}

}  // namespace

StoreTotals TotalsOf(const StoreReader& store) {
  StoreTotals t;
  bool in_chain = false;  // the previous voxel continues in this voxel
  for (const VoxelEntry& v : store.catalog().voxels) {
    t.hot_decoded += v.blocks[0].decoded;
    t.shading_decoded += v.blocks[1].decoded;
    t.stored += v.blocks[0].stored + v.blocks[1].stored;
    t.chained += in_chain || v.next_in_chain != kNoIndex;
    in_chain = v.next_in_chain != kNoIndex;
  }
  for (const Texture& texture : store.textures()) {
    t.pages += texture.pages.size();
    for (const BlockEntry& page : texture.pages) {
      t.pages_stored += page.stored;
      t.pages_decoded += page.decoded;
    }
  }
  return t;
}

std::pair<glm::dvec3, glm::dvec3> ModelBounds(const SceneMeta& m) {
  return {glm::dvec3(m.bounds_lower) + m.offset, glm::dvec3(m.bounds_upper) + m.offset};
}

nlohmann::ordered_json DescribeStore(const StoreReader& store) {
  const Catalog& c = store.catalog();
  const SceneMeta& m = c.meta;
  const StoreTotals t = TotalsOf(store);
  nlohmann::ordered_json j;
  j["scene_id"] = FormatSceneId(c.id);
  j["store_bytes"] = store.size();
  j["input_triangles"] = m.input_triangles;
  j["dropped_degenerate_triangles"] = m.dropped_degenerate;
  j["dropped_not_finite_triangles"] = m.dropped_not_finite;
  j["dropped_transparent_triangles"] = m.dropped_transparent;
  j["opacity_masks"] = m.masks;
  j["voxels"] = c.voxels.size();
  j["chained_voxels"] = t.chained;
  j["stored_triangle_references"] = m.stored_references;
  j["top_tree_nodes"] = c.top_node_count;
  j["voxel_size_bytes"] = m.voxel_size;
  j["largest_decoded_bytes"] = m.largest_decoded;
  j["largest_stored_bytes"] = m.largest_stored;
  j["hot_decoded_bytes"] = t.hot_decoded;
  j["shading_decoded_bytes"] = t.shading_decoded;
  j["blocks_stored_bytes"] = t.stored;
  const auto [lower, upper] = ModelBounds(m);
  j["bounds_lower"] = {lower.x, lower.y, lower.z};
  j["bounds_upper"] = {upper.x, upper.y, upper.z};
  j["up_axis"] = m.up_axis == 1 ? "y" : "z";
  j["offset"] = {m.offset.x, m.offset.y, m.offset.z};
  j["lz4_version"] = m.lz4_version;
  j["materials"] = store.material_names();
  j["parts"] = store.parts();
  j["cameras"] = CamerasToJson(store.views());
  j["lights"] = LightsToJson(store.views());
  j["texture_pages"] = t.pages;
  j["texture_stored_bytes"] = t.pages_stored;
  j["texture_decoded_bytes"] = t.pages_decoded;
  j["textures"] = DescribeTextures(store);
  return j;
}

nlohmann::ordered_json DescribeTextures(const StoreReader& store) {
  constexpr const char* kUses[kTextureUses] = {"diffuse", "specular", "emission",           "opacity",
                                               "normal",  "bump",     "metal and roughness"};
  auto textures = nlohmann::ordered_json::array();
  for (const Texture& texture : store.textures()) textures.push_back(DescribeTexture(texture));
  for (const MaterialTexture& use : store.material_textures())
    textures[use.binding.texture]["uses"].push_back({{"material", use.material},
                                                     {"name", store.material_names()[use.material]},
                                                     {"use", kUses[static_cast<size_t>(use.binding.use)]}});
  return textures;
}

}  // namespace quarry
