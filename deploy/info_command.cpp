#include "deploy/info_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/progress.h"
#include "common/base/size.h"
#include "common/voxel/store_reader.h"

namespace quarry {
namespace {

struct Totals {
  uint64_t hot_decoded = 0, shading_decoded = 0, stored = 0, chained = 0;
  uint64_t pages = 0, pages_stored = 0, pages_decoded = 0;
};

Totals Sum(const StoreReader& store) {
  Totals t;
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

/// The bounds in the model's own coordinates.
std::pair<glm::dvec3, glm::dvec3> ModelBounds(const SceneMeta& m) {
  return {glm::dvec3(m.bounds_lower) + m.offset, glm::dvec3(m.bounds_upper) + m.offset};
}

nlohmann::ordered_json DescribeTexture(const Texture& texture) {
  const char* const formats[] = {"srgb8", "linear8", "half"};
  return {{"name", texture.name},
          {"width", texture.layout.width},
          {"height", texture.layout.height},
          {"channels", texture.layout.channels},
          {"format", formats[static_cast<size_t>(texture.layout.format)]},
          {"pages", texture.pages.size()}};
}

template <class V>
nlohmann::ordered_json Triple(const V& v) {
  return {v.x, v.y, v.z};
}

/// A camera in the model's own coordinates.
nlohmann::ordered_json DescribeCamera(const NamedCamera& camera) {
  nlohmann::ordered_json j{{"name", camera.name},
                           {"eye", Triple(camera.spec.eye)},
                           {"at", Triple(camera.spec.at)},
                           {"up", Triple(camera.spec.up)}};
  if (camera.spec.ortho_height > 0)
    j["ortho_height"] = camera.spec.ortho_height;
  else
    j["fov_degrees"] = camera.spec.fov_degrees;
  return j;
}

nlohmann::ordered_json DescribeLight(const NamedLight& light) {
  const bool sun = light.kind == LightKind::kSun, cone = !sun && light.cos_outer > -1;
  nlohmann::ordered_json j{{"name", light.name}, {"type", sun ? "sun" : cone ? "spot" : "point"}};
  if (!sun) j["position"] = Triple(light.position);
  if (sun || cone) j["direction"] = Triple(light.direction);
  j["radiance"] = Triple(light.radiance);
  if (cone) j["cone_cosines"] = {light.cos_inner, light.cos_outer};
  return j;
}

/// The number of cameras or lights, and the names of the first eight.
template <class View>
std::string Names(const std::vector<View>& views) {
  constexpr size_t kShown = 8;
  std::string names = fmt::format("{}", views.size());
  for (size_t i = 0; i < std::min(views.size(), kShown); ++i)
    names += fmt::format("{}{}", i == 0 ? ": " : ", ", views[i].name);
  return views.size() > kShown ? names + ", ..." : names;
}

nlohmann::ordered_json Describe(const StoreReader& store) {
  const Catalog& c = store.catalog();
  const SceneMeta& m = c.meta;
  const Totals t = Sum(store);
  nlohmann::ordered_json j;
  j["scene_id"] = FormatSceneId(c.id);
  j["store_bytes"] = store.size();
  j["input_triangles"] = m.input_triangles;
  j["dropped_degenerate_triangles"] = m.dropped_degenerate;
  j["dropped_not_finite_triangles"] = m.dropped_not_finite;
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
  j["cameras"] = nlohmann::ordered_json::array();
  for (const NamedCamera& camera : store.views().cameras) j["cameras"].push_back(DescribeCamera(camera));
  j["lights"] = nlohmann::ordered_json::array();
  for (const NamedLight& light : store.views().lights) j["lights"].push_back(DescribeLight(light));
  j["texture_pages"] = t.pages;
  j["texture_stored_bytes"] = t.pages_stored;
  j["texture_decoded_bytes"] = t.pages_decoded;
  j["textures"] = nlohmann::ordered_json::array();
  for (const Texture& texture : store.textures()) j["textures"].push_back(DescribeTexture(texture));
  return j;
}

}  // namespace

Status PrintInfo(const std::string& scene, bool json) {
  QUARRY_ASSIGN(const StoreReader store, StoreReader::Open(scene));
  const auto j = Describe(store);
  if (json) {
    fmt::print("{}\n", j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
    return {};
  }
  const Catalog& c = store.catalog();
  const Totals t = Sum(store);
  const auto kept = c.meta.input_triangles - c.meta.dropped_degenerate - c.meta.dropped_not_finite;
  fmt::print("{}\n  scene      {}\n", scene, FormatSceneId(c.id));
  fmt::print("  triangles  {} ({} degenerate and {} not finite dropped)\n", kept, c.meta.dropped_degenerate,
             c.meta.dropped_not_finite);
  fmt::print("  voxels     {} (replication {:.2f}, largest block {})\n", c.voxels.size(),
             static_cast<double>(c.meta.stored_references) / static_cast<double>(std::max<uint64_t>(kept, 1)),
             FormatSize(c.meta.largest_decoded));
  fmt::print("  size       {} stored, {} hot and {} shading once decoded\n", FormatSize(store.size()),
             FormatSize(t.hot_decoded), FormatSize(t.shading_decoded));
  const auto [lower, upper] = ModelBounds(c.meta);
  fmt::print("  bounds     {:.10g} {:.10g} {:.10g} to {:.10g} {:.10g} {:.10g}, {} up\n", lower.x, lower.y,
             lower.z, upper.x, upper.y, upper.z, c.meta.up_axis == 1 ? "y" : "z");
  if (c.meta.offset != glm::dvec3(0))
    fmt::print("  offset     {:.10g} {:.10g} {:.10g} (stored positions are that much less)\n",
               c.meta.offset.x, c.meta.offset.y, c.meta.offset.z);
  fmt::print("  materials  {}\n  parts      {}\n", store.material_names().size(), store.parts().size());
  if (!store.views().cameras.empty()) fmt::print("  cameras    {}\n", Names(store.views().cameras));
  if (!store.views().lights.empty()) fmt::print("  lights     {}\n", Names(store.views().lights));
  if (t.pages > 0)
    fmt::print("  textures   {} in {} pages, {} stored, {} once decoded\n", store.textures().size(), t.pages,
               FormatSize(t.pages_stored), FormatSize(t.pages_decoded));
  return {};
}

Status Verify(const std::string& scene, bool quiet) {
  QUARRY_ASSIGN(const StoreReader store, StoreReader::Open(scene));
  Progress progress(quiet);
  progress.Begin("verifying " + scene);
  QUARRY_TRY(store.Verify([&](uint64_t done, uint64_t total) { progress.Update(done, total); }));
  progress.End();
  progress.Say(
      fmt::format("{}: {} voxels{}, every byte as it should be", scene, store.catalog().voxels.size(),
                  store.textures().empty() ? "" : fmt::format(", {} textures", store.textures().size())));
  return {};
}

}  // namespace quarry
