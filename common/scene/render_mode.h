#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace quarry {

/// How values of a picture become bytes of a PNG and of the live view, after the exposure: cut off at white,
/// or with bright values brought below it, as film does.
enum class ToneCurve : uint8_t { kClip = 0, kFilm = 1 };
inline constexpr int kToneCurves = 2;
inline constexpr const char* kToneCurveNames[kToneCurves] = {"clip", "film"};

/// Modes of rendering; the README describes them. Their numbers stand in messages and traces.
enum class RenderMode : uint8_t { kRaycast = 0, kShadow = 1, kWhitted = 2, kVoxels = 3, kAo = 4, kPath = 5 };
inline constexpr int kRenderModes = 6;

/// A mode as programs and the page see it. In the engine each mode is a class, see MakeIntegrator().
struct RenderModeInfo {
  RenderMode mode;
  const char* name;      ///< as for --mode
  const char* label;     ///< in the viewer
  uint32_t default_spp;  ///< samples per pixel of a picture that names no number
  bool uses_lights;      ///< else it has its own light
  bool metered;          ///< whether the exposure is measured from the picture; else it is 0 EV
  bool bounces;          ///< light bounces; the live view in motion shows what has not
  ToneCurve tone;        ///< of a picture that names none
  /// Seconds to trace a sample, before any tile is done. Trades balance of a first frame's tiles (too little)
  /// against balance of the bytes to fetch for them (too much): `quarry bench simulate`, history.md
  /// 2026-11-26.
  double sample_s;
  const char* options[8];  ///< of `quarry render`, that other modes may not have
};
/// In the order in which they are shown.
inline constexpr RenderModeInfo kRenderModeInfo[kRenderModes] = {
    {RenderMode::kAo,
     "ao",
     "Soft light (ao)",
     4,
     false,
     true,
     false,
     ToneCurve::kClip,
     1e-6,
     {"--ao-distance", "--ao-samples"}},
    {RenderMode::kRaycast, "raycast", "Ray casting", 1, false, true, false, ToneCurve::kClip, 1e-6, {}},
    {RenderMode::kShadow,
     "shadow",
     "Shadows",
     1,
     true,
     true,
     false,
     ToneCurve::kClip,
     1e-6,
     {"--sun", "--lights"}},
    {RenderMode::kWhitted,
     "whitted",
     "Reflections",
     4,
     true,
     true,
     false,
     ToneCurve::kClip,
     1e-6,
     {"--sun", "--lights"}},
    {RenderMode::kPath,
     "path",
     "Global light (path)",
     64,
     true,
     true,
     true,
     ToneCurve::kFilm,
     2e-5,
     {"--sun", "--lights", "--sky", "--atmosphere", "--bounces", "--environment", "--environment-turn",
      "--environment-strength"}},
    {RenderMode::kVoxels, "voxels", "Voxels", 1, false, false, false, ToneCurve::kClip, 1e-6, {}}};

/// Requires: a known mode. Thread-safe, like the functions below.
const RenderModeInfo& InfoOf(RenderMode mode);
/// The mode of a name, or none.
std::optional<RenderMode> FindRenderMode(std::string_view name);
/// All names.
std::vector<std::string> RenderModeNames();

}  // namespace quarry
