#include "master/jobs/tile_log.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/output_path.h"

namespace quarry {

Result<TileLog> TileLog::Create(const std::string& path) {
  QUARRY_ASSIGN(const OutputPlace place, PlaceOf(path));
  TileLog log;
  // Without O_NONBLOCK, opening a FIFO would wait for a reader that may never come.
  const int fd =
      ::open(place.path.c_str(),
             O_WRONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | (place.stream ? 0 : O_CREAT | O_TRUNC), 0644);
  if (fd >= 0) {
    ::fcntl(fd, F_SETFL, ::fcntl(fd, F_GETFL) & ~O_NONBLOCK);
    log.file_.reset(::fdopen(fd, "w"));
  }
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

void TileLog::Frame(uint32_t number, const View& view) {
  const CameraSpec& c = view.camera;
  const auto vector = [](const glm::dvec3& v) { return nlohmann::json{v.x, v.y, v.z}; };
  auto lights = nlohmann::json::array();
  for (const Light& light : view.lights)
    lights.push_back({light.kind == LightKind::kSun, light.vector.x, light.vector.y, light.vector.z});
  const nlohmann::ordered_json j = {
      {"frame", number},    {"width", view.width}, {"height", view.height}, {"eye", vector(c.eye)},
      {"at", vector(c.at)}, {"up", vector(c.up)},  {"fov", c.fov_degrees},  {"ortho", c.ortho_height},
      {"mode", view.mode},  {"lights", lights}};
  std::fprintf(file_.get(), "%s\n", j.dump().c_str());
}

void TileLog::Tile(uint32_t frame_number, const TileDone& done, const std::string& worker) {
  const nlohmann::ordered_json j = {{"frame", frame_number}, {"tile", done.tile},
                                    {"worker", worker},      {"compute_us", done.compute_us},
                                    {"rays", done.rays},     {"depths", Depths(done.depths)},
                                    {"blocks", done.blocks}};
  std::fprintf(file_.get(), "%s\n", j.dump().c_str());
}

}  // namespace quarry
