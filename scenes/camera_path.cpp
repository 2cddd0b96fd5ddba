#include "scenes/camera_path.h"

#include <fmt/format.h>

#include <algorithm>

namespace quarry::scenes {
namespace {

std::string Vector(const glm::vec3& v) { return fmt::format("[{},{},{}]", v.x, v.y, v.z); }

}  // namespace

std::vector<CameraFrame> WalkAlong(std::span<const CameraKey> keys, int frames, float fov) {
  std::vector<CameraFrame> path;
  for (int i = 0; i < frames; ++i) {
    const float time =
        static_cast<float>(i) * static_cast<float>(keys.size() - 1) / static_cast<float>(frames - 1);
    const size_t key = std::min(static_cast<size_t>(time), keys.size() - 2);
    const float t = time - static_cast<float>(key);
    CameraFrame frame;
    frame.eye = glm::mix(keys[key].eye, keys[key + 1].eye, t);
    frame.at = glm::mix(keys[key].at, keys[key + 1].at, t);
    frame.fov = fov;
    path.push_back(frame);
  }
  return path;
}

std::string CameraPathJson(std::span<const CameraFrame> frames) {
  std::string text = "{\"frames\": [";
  for (size_t i = 0; i < frames.size(); ++i) {
    const CameraFrame& frame = frames[i];
    text += fmt::format("{}\n  {{\"eye\": {}, \"at\": {}, \"up\": {}, \"fov\": {}}}", i ? "," : "",
                        Vector(frame.eye), Vector(frame.at), Vector(frame.up), frame.fov);
  }
  return text + "]}\n";
}

}  // namespace quarry::scenes
