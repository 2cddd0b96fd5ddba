#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/render_mode.h"
#include "common/scene/shown/part_selection.h"
#include "common/scene/shown/section_cut.h"

namespace quarry {

/// Layers of an image beside the colour, in the order of their words in a pixel.
/// Workers leave kNoise and kSamples empty; the master fills them in.
enum class Aov : uint8_t {
  kDepth,
  kNormal,
  kUv,
  kPrimitive,
  kMaterial,
  kPart,
  kVoxel,
  kAlbedo,
  kNoise,
  kSamples
};
inline constexpr int kAovs = 10;
/// A layer: its name, as for --aov, and the number of its 32-bit words.
struct AovInfo {
  const char* name;
  int words;
  bool is_integer;
};
inline constexpr AovInfo kAovInfo[kAovs] = {
    {"depth", 1, false},   {"normal", 3, false}, {"uv", 2, false},   {"primitive", 1, true},
    {"material", 1, true}, {"part", 1, true},    {"voxel", 1, true}, {"albedo", 3, false},
    {"noise", 1, false},   {"samples", 1, true}};

/// Layers that are the mean over the samples of a pixel, as denoisers want them. The others are those of
/// sample 0.
inline constexpr Aov kAveraged[] = {Aov::kNormal, Aov::kAlbedo};

/// A perspective or orthographic camera, of a pinhole or a thin lens. Units: positions, like the positions of
/// lights, are the model's minus SceneMeta::offset, as in the store.
struct CameraSpec {
  glm::dvec3 eye{0, -1, 0}, at{0}, up{0, 0, 1};
  double fov_degrees = 45;  ///< vertical, in (0, 179]
  double ortho_height = 0;  ///< scene units; above 0: orthographic, with this height of the image
  double aperture = 0;      ///< diameter of the lens, scene units; 0: a pinhole, which shows all sharp
  double focus = 0;         ///< distance of what is sharp, along the view, scene units; 0: that of `at`
  bool operator==(const CameraSpec&) const = default;
};

/// Kinds of lights: infinitely far; at a point, in all directions or in a cone; a rectangle that shines from
/// its front.
enum class LightKind : uint8_t { kSun = 0, kPoint = 1, kRectangle = 2 };
inline constexpr int kLightKinds = 3;
/// A light of a view.
struct Light {
  LightKind kind = LightKind::kSun;
  glm::vec3 vector{0, 0, 1};  ///< sun: unit direction toward the sun; point: position; rectangle: its centre
  /// Sun: irradiance/pi at normal incidence; point: the same at distance 1; rectangle: what it emits.
  glm::vec3 radiance{1};
  /// The cone of a point light. Toward a direction with the cosine c to `axis`, the light is multiplied by
  /// the square of cone_scale * c + cone_offset, which is clamped to [0, 1] first. The default is no cone.
  glm::vec3 axis{0, 0, -1};
  float cone_scale = 0, cone_offset = 1;
  float angle = 0.53f;  ///< sun, in mode path: of its disc, degrees, [0, 90]; 0: parallel rays
  /// Rectangle: its sides. Its front is where their cross product points.
  glm::vec3 edges[2] = {glm::vec3(0), glm::vec3(0)};
  bool at_eye = false;  ///< point: NormalizeView() and FrameView() put it where the camera is
  float radius = 0;     ///< point, in mode path: of the sphere that shines, scene units; 0: a point
  bool operator==(const Light&) const = default;
};

struct AtmosphereTable;
/// The light of the sky in mode path. It has one radiance, or is that of a clear day, or of an atmosphere,
/// which is right at sunset too. The latter two follow the view's first sun. An atmosphere is seen behind the
/// scene.
struct Sky {
  glm::vec3 radiance{0};
  float turbidity = 0;  ///< of a clear day, from 2 (very clear) to 10 (hazy); 0: no such sky
  float haze = 0;       ///< of an atmosphere, from 1 (air alone) to 10 (hazy); 0: no such sky
  std::shared_ptr<const AtmosphereTable> atmosphere;  ///< follows from haze and sun; set by FitLight()
  bool shines() const { return turbidity > 0 || haze > 0 || radiance != glm::vec3(0); }
  bool operator==(const Sky& other) const {
    return radiance == other.radiance && turbidity == other.turbidity && haze == other.haze;
  }
};
/// A photographed sky in mode path, which is seen behind the scene too: the store of an image of all
/// directions. Where the z axis is up, its middle lies toward +x, and its right half toward -y; the y axis
/// takes the place of z with -z in that of y.
struct ViewEnvironment {
  std::string name;              ///< by which a master knows it; no part of the picture
  std::array<uint8_t, 16> id{};  ///< the store's scene id; zeros: there is none, or only the name is known
  double turn = 0;               ///< degrees about the up axis, counterclockwise from above
  float strength = 1;            ///< factor of radiance
  bool shines() const { return id != std::array<uint8_t, 16>{}; }
  /// Whether there is one, though its id may not be known yet.
  bool is_named() const { return shines() || !name.empty(); }
  bool operator==(const ViewEnvironment& other) const {
    return id == other.id && turn == other.turn && strength == other.strength;
  }
};

/// Limits of a clear sky: its turbidity, and the sine of 5 degrees, below which the sun must not stand.
inline constexpr float kLeastTurbidity = 2, kMostTurbidity = 10, kLeastSunHeight = 0.0871557f;

/// Limit of a lens's lengths.
inline constexpr double kMostLens = 1e18;
/// Limits of an environment.
inline constexpr double kMostTurn = 3600;
inline constexpr float kMostStrength = 1e6f;

/// A rectangle of an image. Units: pixels, from the image's upper left corner.
struct PixelRect {
  uint32_t x = 0, y = 0, width = 0, height = 0;
  bool operator==(const PixelRect&) const = default;
};

/// A picture of a scene: everything that decides its pixels except the scene.
struct View {
  uint32_t width = 1024, height = 768;  ///< pixels
  PixelRect crop;                       ///< the pixels that are rendered; the whole image when its width is 0
  RenderMode mode = RenderMode::kRaycast;
  uint32_t spp = 1;  ///< samples per pixel
  uint64_t seed = 0;
  uint32_t aov_mask = 0;  ///< a bit for each Aov
  uint32_t up_axis = 0;   ///< of kAo's dome: 1 for y, 2 for z; 0: the scene's
  /// kAo: rays that look for occluders from each point, and their length in scene units; 0: a share of the
  /// scene.
  uint32_t ao_samples = 4;
  float ao_distance = 0;
  uint32_t bounces = 8;         ///< kPath: of a path, before its last ray, which finds lights only
  Sky sky;                      ///< kPath
  ViewEnvironment environment;  ///< kPath; not with a sky
  std::vector<Light> lights;
  glm::vec3 ambient{0.2f};                   ///< radiance
  glm::vec3 background{0.55f, 0.65f, 0.8f};  ///< radiance where a ray hits nothing
  /// Whether primary rays that hit nothing leave the picture uncovered, and kBackdrop is put behind it.
  /// Reflected and refracted rays see `background` either way. False where a background is given: it is
  /// light.
  bool backdrop = true;
  /// Whether primary rays that hit nothing, and no lamp, leave the picture uncovered, whatever sky is there,
  /// and nothing is put behind it.
  bool transparent = false;
  CameraSpec camera;
  ViewParts parts;
  SectionCut section;
  bool edges = false;  ///< whether thin dark lines are drawn where parts or normals meet
  /// Radiance is summed times 2^range, so that noon and candlelight fit sums. Pictures hold it as it is. Set
  /// by who knows the scene, see RangeOf(). In [-kMostRange, kMostRange].
  int range = 0;
  /// kPath: the picture is for an exposure. Light is left out that comes to the eye straight from suns,
  /// rectangles and skies, or by mirrors and glass from these and from surfaces that shine.
  bool meters = false;
  /// The error below which blocks of pixels end before they have `spp` samples, see NoiseBlocks; 0: all have
  /// `spp` samples.
  double noise = 0;
  double metered_ev = 0;  ///< exposure by which NoiseBlocks judges dark blocks. Set by the master.

  bool has(Aov aov) const { return aov_mask >> static_cast<int>(aov) & 1; }
  bool operator==(const View&) const = default;
};

/// Limits of a view: pixels per side, samples per pixel, lights.
inline constexpr uint32_t kMaxImageSide = 65536;
inline constexpr uint32_t kMaxSpp = 1u << 16;
/// Samples per pixel at most of a view that has a noise and names none.
inline constexpr uint32_t kNoiseSpp = 4096;
/// Samples per pixel at least of a view that has a noise: parts of it may end with 16.
inline constexpr uint32_t kLeastNoiseSpp = 17;
/// Limits of View::noise.
inline constexpr double kLeastNoise = 1e-4, kMostNoise = 1;
inline constexpr uint32_t kMaxAoSamples = 256;
inline constexpr uint32_t kMaxLights = 1024;
inline constexpr uint32_t kMaxBounces = 64;
inline constexpr int kMostRange = 64;
inline constexpr uint32_t kTileSize = 32;  ///< side of a tile, pixels

/// Side of a depth cell, in lattice points. For each cell a tile reports the t of the farthest primary ray.
inline constexpr uint32_t kDepthCell = 4;
/// The number of cells that cover `pixels` lattice points.
inline constexpr uint32_t DepthCells(uint32_t pixels) { return (pixels + kDepthCell - 1) / kDepthCell; }

/// Errors (usage): a camera that sees nothing, or a value that is no number; one sentence.
Status CheckCamera(const CameraSpec& camera);

/// Whether a rectangle's sides span an area that floats can hold.
bool HasArea(const glm::vec3 (&edges)[2]);
/// Moves the lights that are at the eye to the view's camera.
void PlaceEyeLights(View& view);

/// Fills in a whole-image crop, makes directions of suns unit vectors, and places lights at the eye.
/// Errors (usage): a size, count, direction or mode is out of range; one sentence.
Status NormalizeView(View& view);

/// Words of a pixel's colour: 3 floats of radiance, and its coverage, the share of samples whose primary ray
/// hits something or sees light. Uncovered samples add no radiance.
inline constexpr uint32_t kColorWords = 4;
/// The colour behind a picture, where nothing covers it. Neither exposure nor mode changes it. It is lighter
/// than exposed surfaces, whose mean becomes 150, and darker than clipped pixels. Units: linear value; 8-bit
/// sRGB is (232, 236, 241).
inline constexpr double kBackdrop[3] = {0.806952, 0.838799, 0.879622};

/// The number of 32-bit words of a pixel in tiles and frames: the colour's, then the layers in order.
uint32_t WordsPerPixel(uint32_t aov_mask);

}  // namespace quarry
