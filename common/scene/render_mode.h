#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace quarry {

/// Modes of rendering; the README describes them. Their numbers stand in messages and traces.
enum class RenderMode : uint8_t { kRaycast = 0, kShadow = 1, kWhitted = 2, kVoxels = 3, kAo = 4, kPath = 5 };
inline constexpr int kRenderModes = 6;

/// A mode as programs and the page see it. In the engine each mode is a class, see MakeIntegrator().
struct RenderModeInfo {
  RenderMode mode;
  const char* name;        ///< as for --mode
  const char* label;       ///< in the viewer
  uint32_t default_spp;    ///< samples per pixel of a picture that names no number
  bool uses_lights;        ///< else it has its own light
  bool metered;            ///< whether the exposure is measured from the picture; else it is 0 EV
  const char* options[4];  ///< of `quarry render`, that other modes may not have
};
/// In the order in which they are shown.
inline constexpr RenderModeInfo kRenderModeInfo[kRenderModes] = {
    {RenderMode::kAo, "ao", "Soft light (ao)", 4, false, true, {"--ao-distance", "--ao-samples"}},
    {RenderMode::kRaycast, "raycast", "Ray casting", 1, false, true, {}},
    {RenderMode::kShadow, "shadow", "Shadows", 1, true, true, {"--sun", "--lights"}},
    {RenderMode::kWhitted, "whitted", "Reflections", 4, true, true, {"--sun", "--lights"}},
    {RenderMode::kPath,
     "path",
     "Global light (path)",
     64,
     true,
     true,
     {"--sun", "--lights", "--sky", "--bounces"}},
    {RenderMode::kVoxels, "voxels", "Voxels", 1, false, false, {}}};

/// Requires: a known mode. Thread-safe, like the functions below.
const RenderModeInfo& InfoOf(RenderMode mode);
/// The mode of a name, or none.
std::optional<RenderMode> FindRenderMode(std::string_view name);
/// All names.
std::vector<std::string> RenderModeNames();

}  // namespace quarry
