#include "tests/scalability/traced_walk.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

#include "common/protocol/messages.h"
#include "master/pictures/frame_image.h"

namespace quarry {
namespace {

using Json = nlohmann::json;
using Frames = std::map<uint32_t, std::pair<View, std::map<uint32_t, TracedWalk::Tile>>>;

/// Depths as TileLog writes them: null where rays hit nothing.
std::vector<float> Depths(const Json& j) {
  std::vector<float> depths;
  for (const Json& depth : j)
    depths.push_back(depth.is_null() ? std::numeric_limits<float>::infinity() : depth.get<float>());
  return depths;
}

/// Adds a result to a tile, which has one for each range of its samples.
void AddResult(const TracedWalk::Tile& result, TracedWalk::Tile& tile) {
  tile.compute_s += result.compute_s;
  tile.depths.resize(std::max(tile.depths.size(), result.depths.size()), 0);
  for (size_t i = 0; i < result.depths.size(); ++i)
    tile.depths[i] = std::max(tile.depths[i], result.depths[i]);
  std::vector<uint32_t> blocks;
  std::ranges::set_union(tile.blocks, result.blocks, std::back_inserter(blocks));
  tile.blocks = std::move(blocks);
}

Status AddLine(const Json& j, Frames& frames) {
  auto& [view, tiles] = frames[j.at("frame").get<uint32_t>()];
  if (j.contains("tile")) {
    AddResult({j.at("compute_us").get<double>() * 1e-6, Depths(j.at("depths")),
               j.at("blocks").get<std::vector<uint32_t>>()},
              tiles[j.at("tile").get<uint32_t>()]);
    return {};
  }
  const auto vector = [&](const char* key) {
    return glm::dvec3(j.at(key).at(0), j.at(key).at(1), j.at(key).at(2));
  };
  view.width = j.at("width");
  view.height = j.at("height");
  view.camera = {vector("eye"), vector("at"), vector("up"), j.at("fov"), j.at("ortho")};
  const unsigned mode = j.at("mode");
  if (mode >= kRenderModes) return Fail("a frame of a mode that there is not");
  view.mode = static_cast<RenderMode>(mode);
  for (const Json& light : j.at("lights"))
    view.lights.push_back({light.at(0) ? LightKind::kSun : LightKind::kPoint,
                           {light.at(1).get<float>(), light.at(2).get<float>(), light.at(3).get<float>()}});
  return NormalizeView(view);
}

/// Whether a master could have received this from its workers.
Status CheckFrame(const std::vector<TracedWalk::Tile>& tiles, const FrameImage& frame,
                  const Catalog& catalog) {
  if (tiles.size() != frame.tiles().size()) return Fail("lacks tiles");
  for (size_t t = 0; t < tiles.size(); ++t) {
    if (tiles[t].depths.size() !=
        size_t{DepthCells(frame.tiles()[t].width)} * DepthCells(frame.tiles()[t].height))
      return Fail("has a tile whose depths do not fit");
    for (const uint32_t block : tiles[t].blocks)
      if (!catalog.BlockOf(block)) return Fail("touches blocks that the store has not");
  }
  return {};
}

}  // namespace

Result<TracedWalk> ReadTracedWalk(const std::string& path, const Catalog& catalog, unsigned step,
                                  unsigned frames) {
  std::ifstream file(path);
  if (!file) return Fail(fmt::format("{}: cannot be read", path));
  Frames found;
  std::string line;
  for (size_t number = 1; std::getline(file, line); ++number) {
    const Json j = Json::parse(line, nullptr, false);
    if (j.is_discarded() && file.peek() == EOF) break;  // the last line of a master that was ended
    try {
      if (const Status status = AddLine(j, found); !status)
        return Fail(fmt::format("{}:{}: {}", path, number, status.error().message));
    } catch (const Json::exception&) {
      return Fail(fmt::format("{}:{}: not what quarry-master --trace writes", path, number));
    }
  }
  TracedWalk walk;
  for (auto& [number, frame] : found) {
    if (number % step != 0 || (frames > 0 && walk.views.size() == frames)) continue;
    if (frame.first.crop.width == 0) return Fail(fmt::format("{}: frame {} has no camera", path, number));
    walk.views.push_back(frame.first);
    walk.tiles.emplace_back();
    for (auto& [t, tile] : frame.second) walk.tiles.back().push_back(std::move(tile));
    if (const Status status = CheckFrame(walk.tiles.back(), FrameImage(frame.first), catalog); !status)
      return Fail(fmt::format("{}: frame {} {}", path, number, status.error().message));
  }
  if (walk.views.empty()) return Fail(fmt::format("{}: has no frames", path));
  return walk;
}

}  // namespace quarry
