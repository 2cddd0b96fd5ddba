#include "master/tile_log.h"

#include <fmt/format.h>

#include <cerrno>
#include <cmath>
#include <nlohmann/json.hpp>

namespace quarry {

Result<TileLog> TileLog::Create(const std::string& path) {
  TileLog log;
  log.file_.reset(std::fopen(path.c_str(), "w"));
  if (!log.file_) return Fail(fmt::format("{}: cannot be written: {}", path, ErrnoText(errno)));
  std::setvbuf(log.file_.get(), nullptr, _IOLBF, 1 << 16);  // whole lines, however the master ends
  return log;
}

namespace {

/// JSON has no infinity: null.
nlohmann::json Depths(const std::vector<float>& depths) {
  auto out = nlohmann::json::array();
  for (const float depth : depths)
    out.push_back(std::isfinite(depth) ? nlohmann::json(depth) : nlohmann::json());
  return out;
}

}  // namespace

void TileLog::Frame(const ActiveFrame& frame) {
  const RenderJob& job = frame.job();
  const CameraSpec& c = job.cameras[0];
  const auto vector = [](const glm::dvec3& v) { return nlohmann::json{v.x, v.y, v.z}; };
  auto lights = nlohmann::json::array();
  for (const Light& light : job.lights)
    lights.push_back({light.kind == LightKind::kSun, light.vector.x, light.vector.y, light.vector.z});
  const nlohmann::ordered_json j = {
      {"frame", job.first_frame}, {"width", job.width}, {"height", job.height}, {"eye", vector(c.eye)},
      {"at", vector(c.at)},       {"up", vector(c.up)}, {"fov", c.fov_degrees}, {"ortho", c.ortho_height},
      {"mode", job.mode},         {"lights", lights}};
  std::fprintf(file_.get(), "%s\n", j.dump().c_str());
}

void TileLog::Tile(const ActiveFrame& frame, const TileDone& done, const std::string& worker) {
  const nlohmann::ordered_json j = {{"frame", frame.job().first_frame},
                                    {"tile", done.tile},
                                    {"worker", worker},
                                    {"compute_us", done.compute_us},
                                    {"rays", done.rays},
                                    {"depths", Depths(done.depths)},
                                    {"blocks", done.blocks}};
  std::fprintf(file_.get(), "%s\n", j.dump().c_str());
}

}  // namespace quarry
