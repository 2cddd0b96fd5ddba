#include "common/voxel/store_description.h"

#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "common/scene/scene_summary.h"
#include "common/voxel/part_tree.h"

namespace quarry {
namespace {

nlohmann::ordered_json DescribeTexture(const Texture& texture, std::string name) {
  const char* const formats[] = {"srgb8", "linear8", "half"};
  uint64_t stored = 0, decoded = 0;
  for (const BlockEntry& page : texture.pages) {
    stored += page.stored;
    decoded += page.decoded;
  }
  return {{"name", std::move(name)},
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

/// Counts the bytes of names that a description holds. Entries of a forged store may all name one long
/// string.
class NameBudget {
 public:
  /// The names of a material are repeated with each use of its textures.
  static constexpr uint64_t kMostCopies = 1 + kTextureUses;
  explicit NameBudget(const StoreReader& store) : store_(store), left_(kMostCopies * store.name_bytes()) {}

  Result<std::string> Take(Result<std::string> name) {
    if (name && name->size() > left_)
      return Fail(fmt::format("{}: its entries refer to more names than it has; make the store again",
                              store_.path()));
    if (name) left_ -= name->size();
    return name;
  }

 private:
  const StoreReader& store_;
  uint64_t left_;
};

/// The paths of all parts. Errors: as PartTree::Read(); paths that are far longer than names of models: a
/// forged store may put many parts below a long path.
Result<nlohmann::ordered_json> PartPaths(const StoreReader& store) {
  constexpr uint64_t kMostCopies = 64;
  QUARRY_ASSIGN(const std::shared_ptr<const PartTree> tree, PartTree::Read(store));
  uint64_t left = kMostCopies * store.name_bytes();
  auto paths = nlohmann::ordered_json::array();
  for (uint32_t part = 0; part < tree->size(); ++part) {
    std::string path = tree->Path(part);
    if (path.size() > left)
      return Fail(
          fmt::format("{}: the paths of its parts are too long together to be listed as JSON", store.path()));
    left -= path.size();
    paths.push_back(std::move(path));
  }
  return paths;
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

nlohmann::ordered_json DescribeFacts(const StoreReader& store) {
  const Catalog& c = store.catalog();
  const SceneMeta& m = c.meta;
  const StoreTotals t = TotalsOf(store);
  nlohmann::ordered_json j;
  j["scene_id"] = FormatSceneId(c.id);
  j["models"] = store.models().names;
  j["store_bytes"] = store.size();
  j["input_triangles"] = m.input_triangles;
  j["dropped_degenerate_triangles"] = m.dropped_degenerate;
  j["dropped_not_finite_triangles"] = m.dropped_not_finite;
  j["dropped_transparent_triangles"] = m.dropped_transparent;
  j["opacity_masks"] = m.masks;
  j["plain"] = IsPlain(c);
  j["shines"] = Shines(c);
  j["names_emitters"] = c.names_emitters;
  if (c.sky) {
    const SkyTable::Facts& sky = c.sky->facts();
    j["environment"] = {{"width", c.sky->cells().width()},
                        {"height", c.sky->cells().height()},
                        {"mean", {sky.mean.x, sky.mean.y, sky.mean.z}},
                        {"brightest", sky.brightest}};
  }
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
  j["cameras"] = CamerasToJson(store.views());
  j["lights"] = LightsToJson(store.views());
  j["texture_pages"] = t.pages;
  j["texture_stored_bytes"] = t.pages_stored;
  j["texture_decoded_bytes"] = t.pages_decoded;
  return j;
}

Result<nlohmann::ordered_json> DescribeStore(const StoreReader& store) {
  nlohmann::ordered_json j = DescribeFacts(store);
  NameBudget names(store);
  auto& materials = j["materials"] = nlohmann::ordered_json::array();
  for (uint32_t m = 0; m < store.catalog().materials.size(); ++m) {
    QUARRY_ASSIGN(std::string name, names.Take(store.MaterialName(m)));
    materials.push_back(std::move(name));
  }
  QUARRY_ASSIGN(j["parts"], PartPaths(store));
  QUARRY_ASSIGN(j["textures"], DescribeTextures(store));
  return j;
}

Result<nlohmann::ordered_json> DescribeTextures(const StoreReader& store) {
  constexpr const char* kUses[kTextureUses] = {"diffuse", "specular", "emission",           "opacity",
                                               "normal",  "bump",     "metal and roughness"};
  NameBudget names(store);
  auto textures = nlohmann::ordered_json::array();
  for (uint32_t t = 0; t < store.textures().size(); ++t) {
    QUARRY_ASSIGN(std::string name, names.Take(store.TextureName(t)));
    textures.push_back(DescribeTexture(store.textures()[t], std::move(name)));
  }
  for (const MaterialTexture& use : store.material_textures()) {
    QUARRY_ASSIGN(std::string name, names.Take(store.MaterialName(use.material)));
    textures[use.binding.texture]["uses"].push_back({{"material", use.material},
                                                     {"name", std::move(name)},
                                                     {"use", kUses[static_cast<size_t>(use.binding.use)]}});
  }
  return textures;
}

}  // namespace quarry
