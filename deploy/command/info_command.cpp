#include "deploy/command/info_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/log.h"
#include "common/base/progress.h"
#include "common/base/size.h"
#include "common/remote/open_store.h"
#include "common/voxel/store_description.h"
#include "common/voxel/store_reader.h"

namespace quarry {
namespace {

/// Number of names shown for models, cameras and lights.
constexpr size_t kShown = 8;

/// The number of cameras or lights, and the names of the first eight.
template <class View>
std::string Names(const std::vector<View>& views) {
  std::string names = fmt::format("{}", views.size());
  for (size_t i = 0; i < std::min(views.size(), kShown); ++i)
    names += fmt::format("{}{}", i == 0 ? ": " : ", ", PrintableName(views[i].name));
  return views.size() > kShown ? names + ", ..." : names;
}

/// The names of the first eight models, and how many others there are.
std::string Names(const ModelNames& models) {
  const size_t shown = std::min(models.names.size(), kShown);
  std::string names;
  for (size_t i = 0; i < shown; ++i) names += (i == 0 ? "" : ", ") + PrintableName(models.names[i]);
  return models.count > shown ? fmt::format("{} and {} others", names, models.count - shown) : names;
}

/// The facts of an environment's store.
void PrintEnvironment(const std::string& place, const StoreReader& store) {
  const SkyTable& sky = *store.catalog().sky;
  const SkyTable::Facts& facts = sky.facts();
  const StoreTotals t = TotalsOf(store);
  Print(fmt::format(
      "{}\n  environment {}\n  image       {}\n  size        {} x {} pixels in {} pages, {} stored, {} once "
      "decoded\n  radiance    mean {:.4g} {:.4g} {:.4g}, brightest {:.4g}\n",
      place, FormatSceneId(store.catalog().id), Names(store.models()), sky.cells().width(),
      sky.cells().height(), t.pages, FormatSize(store.size()), FormatSize(t.pages_decoded), facts.mean.x,
      facts.mean.y, facts.mean.z, facts.brightest));
}

}  // namespace

Status PrintInfo(const std::string& scene, bool json, const HttpOptions& http) {
  QUARRY_ASSIGN(const StoreReader store, OpenStore(scene, http));
  if (json) {
    QUARRY_ASSIGN(const auto j, DescribeStore(store));
    PrintRaw(j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
    return {};
  }
  if (store.catalog().sky) return PrintEnvironment(scene, store), Status{};
  const Catalog& c = store.catalog();
  const StoreTotals t = TotalsOf(store);
  const uint64_t kept = c.meta.kept_triangles();
  Print(fmt::format("{}\n  scene      {}\n", scene, FormatSceneId(c.id)));
  if (store.models().count > 0)
    Print(
        fmt::format("  {:<10} {}\n", store.models().count == 1 ? "model" : "models", Names(store.models())));
  Print(fmt::format("  triangles  {} ({} degenerate and {} not finite dropped)\n", kept,
                    c.meta.dropped_degenerate, c.meta.dropped_not_finite));
  if (c.meta.dropped_transparent > 0)
    Print(fmt::format("  cut out    {} triangles dropped that are transparent all over\n",
                      c.meta.dropped_transparent));
  Print(fmt::format(
      "  voxels     {} (replication {:.2f}, largest block {})\n", c.voxels.size(),
      static_cast<double>(c.meta.stored_references) / static_cast<double>(std::max<uint64_t>(kept, 1)),
      FormatSize(c.meta.largest_decoded)));
  Print(fmt::format("  size       {} stored, {} hot and {} shading once decoded\n", FormatSize(store.size()),
                    FormatSize(t.hot_decoded), FormatSize(t.shading_decoded)));
  const auto [lower, upper] = ModelBounds(c.meta);
  Print(fmt::format("  bounds     {:.10g} {:.10g} {:.10g} to {:.10g} {:.10g} {:.10g}, {} up\n", lower.x,
                    lower.y, lower.z, upper.x, upper.y, upper.z, c.meta.up_axis == 1 ? "y" : "z"));
  const glm::dvec3 extent = upper - lower;
  Print(fmt::format("  extent     {:.6g} x {:.6g} x {:.6g} scene units\n", extent.x, extent.y, extent.z));
  if (c.meta.offset != glm::dvec3(0))
    Print(fmt::format("  offset     {:.10g} {:.10g} {:.10g} (stored positions are that much less)\n",
                      c.meta.offset.x, c.meta.offset.y, c.meta.offset.z));
  Print(fmt::format("  materials  {}\n  parts      {}\n", c.materials.size(), store.part_count()));
  if (!store.views().cameras.empty()) Print(fmt::format("  cameras    {}\n", Names(store.views().cameras)));
  if (!store.views().lights.empty()) Print(fmt::format("  lights     {}\n", Names(store.views().lights)));
  if (t.pages > 0)
    Print(fmt::format("  textures   {} in {} pages, {} stored ({:.0f} % of the store), {} once decoded\n",
                      store.textures().size(), t.pages, FormatSize(t.pages_stored),
                      100 * static_cast<double>(t.pages_stored) / static_cast<double>(store.size()),
                      FormatSize(t.pages_decoded)));
  return {};
}

Status PrintTextures(const std::string& scene, bool json, const HttpOptions& http) {
  QUARRY_ASSIGN(const StoreReader store, OpenStore(scene, http));
  QUARRY_ASSIGN(const auto textures, DescribeTextures(store));
  if (json) {
    PrintRaw(textures.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
    return {};
  }
  for (size_t i = 0; i < textures.size(); ++i) {
    const auto& t = textures[i];
    const auto number = [&](const char* key) { return t[key].get<uint64_t>(); };
    Print(fmt::format("texture {} {}\n", i, PrintableName(t["name"].get<std::string>())));
    Print(fmt::format("  {} x {}, {} levels, {} channels, {}; {} pages, {} stored, {} once decoded\n",
                      number("width"), number("height"), number("levels"), number("channels"),
                      t["format"].get<std::string>(), number("pages"), FormatSize(number("stored_bytes")),
                      FormatSize(number("decoded_bytes"))));
    for (const auto& use : t["uses"])
      Print(fmt::format("  {} of material {} {}\n", use["use"].get<std::string>(),
                        use["material"].get<uint32_t>(), PrintableName(use["name"].get<std::string>())));
  }
  return {};
}

Status Verify(const std::string& scene, bool quiet, const HttpOptions& http) {
  QUARRY_ASSIGN(const StoreReader store, OpenStore(scene, http));
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
