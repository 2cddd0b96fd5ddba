#pragma once

#include <glm/glm.hpp>
#include <span>
#include <string>
#include <vector>

namespace quarry::scenes {

struct CameraFrame {
  glm::vec3 eye, at;
  glm::vec3 up{0, 0, 1};
  float fov = 60;  ///< Vertical, in degrees.
};

/// A point that a walk passes, and the point that it looks at there. Keys are equally far apart in time.
struct CameraKey {
  glm::vec3 eye, at;
};

/// `frames` frames along straight lines between the keys, from first to last. A polyline stays where it was
/// drawn; a spline does not.
std::vector<CameraFrame> WalkAlong(std::span<const CameraKey> keys, int frames, float fov);

/// {"frames": [{"eye": [x,y,z], "at": [..], "up": [..], "fov": degrees}, ...]}
std::string CameraPathJson(std::span<const CameraFrame> frames);

}  // namespace quarry::scenes
