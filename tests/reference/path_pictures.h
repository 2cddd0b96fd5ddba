#pragma once

// Models of quadrilaterals, and their pictures in mode `path`.

#include <array>
#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "common/engine/integrators/path/path_tracer.h"
#include "common/engine/renderer.h"
#include "common/scene/material_json.h"
#include "tests/reference/path_fixture.h"
#include "tests/reference/scene_fixture.h"

namespace quarry::test {

/// A model of quadrilaterals, each with its material.
class Quads {
 public:
  void Add(const glm::vec3& corner, const glm::vec3& a, const glm::vec3& b, uint32_t material) {
    quads_.push_back({{corner, corner + a, corner + a + b, corner + b}, material});
  }
  /// A box seen from inside.
  void AddRoom(const glm::vec3& lower, const glm::vec3& upper, uint32_t material) {
    const glm::vec3 d = upper - lower, x(d.x, 0, 0), y(0, d.y, 0), z(0, 0, d.z);
    Add(lower, x, y, material), Add(lower, y, z, material), Add(lower, z, x, material);
    Add(upper, -y, -x, material), Add(upper, -z, -y, material), Add(upper, -x, -z, material);
  }
  /// The part of a quadrilateral has the number of its material. `images`: of the materials.
  Scene Made(const TemporaryFolder& folder, const std::vector<Material>& materials,
             const std::vector<std::vector<MaterialLibrary::Image>>& images = {}) const {
    std::ofstream out(folder.file("m.ply"));
    out.precision(9);
    out << "ply\nformat ascii 1.0\nelement vertex " << 4 * quads_.size()
        << "\nproperty float x\nproperty float y\nproperty float z\nproperty float s\nproperty float "
           "t\nelement face "
        << quads_.size()
        << "\nproperty list uchar int vertex_indices\nproperty int material_index\nproperty int "
           "part_index\nend_header\n";
    for (const Quad& quad : quads_)
      for (size_t c = 0; c < 4; ++c) {
        const glm::vec3& p = quad.corners[c];
        out << p.x << ' ' << p.y << ' ' << p.z << ' ' << (c == 1 || c == 2) << ' ' << (c > 1) << '\n';
      }
    for (size_t i = 0; i < quads_.size(); ++i)
      out << "4 " << 4 * i << ' ' << 4 * i + 1 << ' ' << 4 * i + 2 << ' ' << 4 * i + 3 << ' '
          << quads_[i].material << ' ' << quads_[i].material << '\n';
    out.close();
    std::ofstream library(folder.file("m.materials.json"));
    std::vector<std::string> parts;
    for (size_t i = 0; i < materials.size(); ++i) parts.push_back("part " + std::to_string(i));
    WriteMaterialJson({materials, parts, images, {}}, library);
    library.close();
    MakeStore({.models = {folder.file("m.ply")}, .output = folder.file("s"), .up_axis = 2});
    auto scene = Scene::Open(folder.file("s"));
    REQUIRE(scene.has_value());
    return *std::move(scene);
  }

 private:
  struct Quad {
    std::array<glm::vec3, 4> corners;
    uint32_t material;
  };
  std::vector<Quad> quads_;
};

inline View LookingAt(const glm::dvec3& eye, const glm::dvec3& at, uint32_t side, uint32_t spp) {
  View view;
  view.width = view.height = side;
  view.mode = RenderMode::kPath;
  view.spp = spp;
  view.camera.eye = eye;
  view.camera.at = at;
  view.camera.up = {0.1, 1, 0.2};
  view.camera.fov_degrees = 40;
  return view;
}

/// The red radiance of each pixel. `ways`, `choice`: of mode `path`.
inline std::vector<double> Picture(const Scene& scene, View view, LightWays ways = LightWays::kBoth,
                                   FilmFaults* faults = nullptr,
                                   EmitterChoice choice = EmitterChoice::kNear) {
  REQUIRE(NormalizeView(view).has_value());
  const auto renderer = Renderer::Create(scene, {.cache_bytes = 64 << 20, .threads = 2});
  REQUIRE(renderer.has_value());
  const std::vector<Tile> tiles = TilesOf(view.crop);
  std::vector<double> picture(size_t{view.width} * view.height);
  const auto put = [&](size_t i, const RenderedTile& result, Renderer::Progress) {
    if (faults) faults->long_light_rays += result.faults.long_light_rays;
    ByteReader in(result.pixels);
    for (uint32_t y = 0; y < tiles[i].rows(); ++y)
      for (uint32_t x = 0; x < tiles[i].columns(); ++x) {
        picture[size_t{tiles[i].Y(y)} * view.width + tiles[i].X(x)] = static_cast<double>(in.Get<float>());
        for (int rest = 0; rest < 3; ++rest) in.Get<float>();
      }
  };
  std::shared_ptr<const Integrator> integrator;
  if (view.mode == RenderMode::kPath)
    integrator = std::make_shared<const PathTracer>(view, scene.catalog(), ways, EnvironmentPages{}, choice);
  const Status status = (*renderer)->Render(view, tiles, put, {}, integrator);
  REQUIRE(status.has_value());
  return picture;
}

inline double MeanOf(const std::vector<double>& picture) {
  return std::accumulate(picture.begin(), picture.end(), 0.0) / static_cast<double>(picture.size());
}

/// Means and standard errors of blocks of `picture`s with different seeds.
struct Blocks {
  static constexpr uint32_t kSide = 8;
  std::vector<Mean> means;
};
inline Blocks BlocksOf(const Scene& scene, View view, LightWays ways, uint32_t seeds) {
  Blocks blocks;
  const uint32_t across = view.width / Blocks::kSide;
  blocks.means.resize(size_t{across} * across);
  for (uint32_t seed = 0; seed < seeds; ++seed) {
    view.seed = seed + 1;
    const std::vector<double> picture = Picture(scene, view, ways);
    std::vector<double> sums(blocks.means.size());
    for (uint32_t y = 0; y < view.height; ++y)
      for (uint32_t x = 0; x < view.width; ++x)
        sums[y / Blocks::kSide * across + x / Blocks::kSide] += picture[size_t{y} * view.width + x];
    for (size_t i = 0; i < sums.size(); ++i) blocks.means[i].Add(sums[i] / (Blocks::kSide * Blocks::kSide));
  }
  return blocks;
}

/// Checks that two ways see the same light: blocks within six standard errors, and nearly all within four.
inline void CheckAgreement(const Blocks& a, const Blocks& b) {
  int beyond = 0;
  double difference = 0, variance = 0;
  for (size_t i = 0; i < a.means.size(); ++i) {
    const double sigma = std::hypot(a.means[i].sigma(), b.means[i].sigma()) + 1e-7;
    const double off = a.means[i].value() - b.means[i].value();
    INFO("block " << i << ": " << a.means[i].value() << " and " << b.means[i].value() << ", sigma " << sigma);
    CHECK(std::fabs(off) < 6 * sigma);
    beyond += std::fabs(off) > 4 * sigma;
    difference += off;
    variance += sigma * sigma;
  }
  CHECK(beyond <= static_cast<int>(a.means.size() / 64));
  INFO("means differ by " << difference / static_cast<double>(a.means.size()));
  CHECK(std::fabs(difference) < 4 * std::sqrt(variance));
}

/// Lights that vertices ask for, lights that paths meet, and both together give one picture.
inline void CheckWays(const Scene& scene, const View& view, const char* which) {
  INFO(which);
  constexpr uint32_t kSeeds = 12;
  const Blocks both = BlocksOf(scene, view, LightWays::kBoth, kSeeds);
  CheckAgreement(both, BlocksOf(scene, view, LightWays::kAsked, kSeeds));
  CheckAgreement(both, BlocksOf(scene, view, LightWays::kMet, kSeeds));
}

}  // namespace quarry::test
