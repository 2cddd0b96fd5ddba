#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/material.h"
#include "scenes/builder.h"
#include "scenes/camera_path.h"

namespace quarry::scenes {

inline constexpr uint64_t kFewestTriangles = 1000;
inline constexpr uint64_t kMostTriangles = 1000000000;

struct SceneOptions {
  uint64_t triangles = 1000000;
  uint64_t seed = 1;
  bool colors = true;  ///< of vertices
  /// Of a plant: tubes that shine, two of its triangles each. Requires: kFewestTriangles are left.
  uint64_t lamps = 0;
};

/// A procedural scene: a pure function of its options. z is up, units are metres.
class Scene {
 public:
  virtual ~Scene() = default;
  virtual std::vector<Material> Materials() const = 0;
  /// Draws exactly options.triangles triangles, the same each time, in memory that does not depend on their
  /// number.
  virtual void Draw(Builder& builder) const = 0;
  /// 60 frames of a path through the scene, outside of all solids.
  virtual std::vector<CameraFrame> Path() const = 0;
};

/// The names MakeScene() knows.
const std::vector<std::string>& SceneKinds();

/// Requires: `kind` is one of SceneKinds(), options.triangles from kFewestTriangles to kMostTriangles.
std::unique_ptr<Scene> MakeScene(const std::string& kind, const SceneOptions& options);

/// Called now and then with the triangles done of all triangles (counted in every pass); an error ends the
/// writing.
using WatchProgress = std::function<Status(uint64_t done, uint64_t total)>;

/// Writes the scene to `path` (see OpenMeshWriter()) and its camera path to NAME.path.json. On an error no
/// file is left. Memory: a few MB. Errors: a write error; as `watch`'s.
Status WriteScene(const Scene& scene, const SceneOptions& options, const std::string& path,
                  const WatchProgress& watch);

// The scenes, one per file.
std::unique_ptr<Scene> MakePlant(const SceneOptions& options);
std::unique_ptr<Scene> MakeCity(const SceneOptions& options);
std::unique_ptr<Scene> MakeTerrain(const SceneOptions& options);
std::unique_ptr<Scene> MakeForest(const SceneOptions& options);
std::unique_ptr<Scene> MakeStadium(const SceneOptions& options);
std::unique_ptr<Scene> MakeCornell(const SceneOptions& options);

}  // namespace quarry::scenes
