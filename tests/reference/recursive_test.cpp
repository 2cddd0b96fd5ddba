// Mode `path` against an independent tracer: recursive_tracer.h, which shares no code with it but the store,
// the materials and the view.
//
// How pictures are compared: each program renders a picture with each of kSeeds seeds. A block of 8x8 pixels
// has a mean for each channel and seed. The spread over seeds gives the standard error of a block's mean; the
// sigma of the difference is made of both programs' errors. At most one block in 1,000 may differ by more
// than 4 sigma, and none by more than 6. The means of whole pictures may differ by 4 of their own sigmas.
// These come from the seeds' whole pictures, so that noise that blocks share counts.
//
// kSeeds: sigmas of few seeds are themselves uncertain. With 64 seeds a program, 126 degrees of freedom, a
// right picture has 1 in 10,000 blocks beyond 4 sigma and 2 in 100 million beyond 6. A block that is lit by a
// few rare paths still has too small a sigma when they are missed, so lamps are large. A sigma of the means
// of 0.4 % at most is asked for, so that noise hides no error of a few percent.
//
// The models have no textures here, nor cut-outs: filters are another subject. recursive_tracer.h names the
// rest that is left out.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>
#include <numeric>
#include <sstream>

#include "common/engine/integrators/path/light_range.h"
#include "common/engine/renderer.h"
#include "common/scene/material_json.h"
#include "tests/reference/path_fixture.h"
#include "tests/reference/recursive_tracer.h"
#include "tests/reference/scene_fixture.h"
#include "tests/support/skip.h"

namespace quarry::test {
namespace {

constexpr uint32_t kSeeds = 64;
constexpr uint32_t kBlock = 8;

/// Means with standard errors, by block and channel, and of the whole picture's channels.
struct Blocks {
  std::vector<Mean> blocks;
  Mean whole[3];

  void Add(const std::vector<glm::dvec3>& picture, uint32_t width) {
    const uint32_t across = width / kBlock;
    blocks.resize(picture.size() / (kBlock * kBlock) * 3);
    std::vector<glm::dvec3> sums(blocks.size() / 3);
    for (size_t i = 0; i < picture.size(); ++i)
      sums[i / width / kBlock * across + i % width / kBlock] += picture[i] / (1.0 * kBlock * kBlock);
    const glm::dvec3 all = std::accumulate(sums.begin(), sums.end(), glm::dvec3(0));
    for (int c = 0; c < 3; ++c) {
      for (size_t i = 0; i < sums.size(); ++i) blocks[3 * i + static_cast<size_t>(c)].Add(sums[i][c]);
      whole[c].Add(all[c] / static_cast<double>(sums.size()));
    }
  }
};

/// The sigma of the difference of two means of kSeeds values each.
double SigmaOf(const Mean& a, const Mean& b) {
  return std::hypot(a.sigma(), b.sigma()) * std::sqrt(kSeeds / (kSeeds - 1.0));
}

std::vector<glm::dvec3> Rendered(Renderer& renderer, const View& view) {
  const std::vector<Tile> tiles = TilesOf(view.crop);
  std::vector<glm::dvec3> picture(size_t{view.width} * view.height);
  const auto put = [&](size_t i, const RenderedTile& result, Renderer::Progress) {
    ByteReader in(result.pixels);
    for (uint32_t y = 0; y < tiles[i].rows(); ++y)
      for (uint32_t x = 0; x < tiles[i].columns(); ++x) {
        glm::dvec3& pixel = picture[size_t{tiles[i].Y(y)} * view.width + tiles[i].X(x)];
        for (int c = 0; c < 3; ++c) pixel[c] = static_cast<double>(in.Get<float>());
        in.Get<float>();  // coverage
      }
  };
  const Status status = renderer.Render(view, tiles, put);
  INFO((status ? "" : status.error().message));
  REQUIRE(status.has_value());
  return picture;
}

/// Compares pictures of a store. Quarry takes view.spp samples a pixel and seed, the independent tracer the
/// square of `side`.
void Compare(const std::string& name, const std::string& store, View view, int side) {
  INFO(name);
  const auto scene = Scene::Open(store);
  REQUIRE(scene.has_value());
  view.mode = RenderMode::kPath;
  view.background = glm::vec3(0);
  view.backdrop = false;
  view.range = RangeOf(view, scene->catalog());
  REQUIRE(NormalizeView(view).has_value());
  Blocks quarry, other;
  {
    const auto renderer = Renderer::Create(*scene, {.cache_bytes = 1u << 30, .threads = 2});
    REQUIRE(renderer.has_value());
    for (uint32_t seed = 1; seed <= kSeeds; ++seed) {
      view.seed = seed;
      quarry.Add(Rendered(**renderer, view), view.width);
    }
  }
  const RecursiveModel model(scene->store());
  const RecursiveTracer tracer(model, view);
  for (uint32_t seed = 1; seed <= kSeeds; ++seed) other.Add(tracer.Picture(seed, side), view.width);

  size_t beyond = 0, lit = 0;
  double farthest = 0;
  std::ostringstream which;
  for (size_t i = 0; i < quarry.blocks.size(); ++i) {
    const Mean &a = quarry.blocks[i], &b = other.blocks[i];
    // The last term: floats of pixels, for blocks that only surfaces without noise fill.
    const double sigma = SigmaOf(a, b) + 1e-6 * std::fabs(b.value()) + 1e-12;
    const double off = (a.value() - b.value()) / sigma;
    INFO("block " << i / 3 << ", channel " << i % 3 << ": " << a.value() << " and " << b.value() << ", sigma "
                  << sigma);
    CHECK(std::fabs(off) < 6);
    if (std::fabs(off) > 4) {
      ++beyond;
      which << "\n  block " << i / 3 << ", channel " << i % 3 << ": " << a.value() << " and " << b.value()
            << ", sigma " << sigma;
    }
    lit += b.value() > 0 ? 1 : 0;
    farthest = std::max(farthest, std::fabs(off));
  }
  CHECK(beyond <= quarry.blocks.size() / 1000);
  CHECK(lit > quarry.blocks.size() / 2);
  std::string means;
  for (int c = 0; c < 3; ++c) {
    const Mean &a = quarry.whole[c], &b = other.whole[c];
    const double sigma = SigmaOf(a, b);
    INFO("channel " << c << ": means " << a.value() << " and " << b.value() << ", sigma " << sigma);
    CHECK(std::fabs(a.value() - b.value()) < 4 * sigma);
    CHECK(sigma < 0.004 * b.value());
    means += " " + std::to_string(100 * (a.value() / b.value() - 1)) + " % (" +
             std::to_string((a.value() - b.value()) / sigma) + " sigma, " +
             std::to_string(100 * sigma / b.value()) + " %)";
  }
  WARN(name << ": " << quarry.blocks.size() << " blocks and channels, " << beyond
            << " beyond 4 sigma, farthest " << farthest << " sigma; means differ by" << means << which.str());
}

/// Makes a store of a model without its textures and compares.
void CompareModel(const std::string& name, const View& view, int side) {
  const std::string folder = ScenesFolder();
  if (folder.empty() || !std::filesystem::is_regular_file(folder + "/" + name))
    return Skip(name + " (the folder of real models is not there)");
  const TemporaryFolder made;
  const std::string store = made.file("scene.quarry");
  MakeStore({.models = {folder + "/" + name}, .output = store, .threads = 2, .textures = false});
  Compare(name, store, view, side);
}

/// The camera leans, so that no edge runs along rows of pixels: Quarry's first sample is always the pixel's
/// centre, which shifts such an edge, all along, by up to 1 / view.spp of a pixel. `spp`: a power of two, for
/// which samples fill a pixel evenly.
View Looking(const glm::dvec3& eye, const glm::dvec3& at, double fov, uint32_t side, uint32_t spp) {
  View view;
  view.width = view.height = side;
  view.spp = spp;
  view.camera.eye = eye;
  view.camera.at = at;
  view.camera.up = {0.1, 1, 0};
  view.camera.fov_degrees = fov;
  view.bounces = 3;
  return view;
}

/// A model of triangles with normals and colours of vertices, each with its material.
class Shapes {
 public:
  struct Vertex {
    glm::dvec3 at, normal;
    glm::ivec3 color{255};
  };
  /// A flat parallelogram; its corners have these colours.
  void AddPlate(const glm::dvec3& corner, const glm::dvec3& a, const glm::dvec3& b, int material,
                const std::array<glm::ivec3, 4>& colors = {glm::ivec3(255), glm::ivec3(255), glm::ivec3(255),
                                                           glm::ivec3(255)}) {
    const glm::dvec3 normal = glm::normalize(glm::cross(a, b));
    const int first = static_cast<int>(vertices_.size());
    vertices_.push_back({corner, normal, colors[0]});
    vertices_.push_back({corner + a, normal, colors[1]});
    vertices_.push_back({corner + a + b, normal, colors[2]});
    vertices_.push_back({corner + b, normal, colors[3]});
    faces_.push_back({first, first + 1, first + 2, material});
    faces_.push_back({first, first + 2, first + 3, material});
  }
  /// A coarse ball with the normals of a round one, so that the two kinds of normals differ.
  void AddBall(const glm::dvec3& centre, double radius, int material, int turns = 16) {
    const int rings = turns / 2, first = static_cast<int>(vertices_.size());
    for (int ring = 0; ring <= rings; ++ring)
      for (int turn = 0; turn <= turns; ++turn) {
        const double down = kPi * ring / rings, around = 2 * kPi * turn / turns;
        const glm::dvec3 normal(std::sin(down) * std::cos(around), std::sin(down) * std::sin(around),
                                std::cos(down));
        vertices_.push_back({centre + normal * radius, normal, glm::ivec3(255)});
      }
    for (int ring = 0; ring < rings; ++ring)
      for (int turn = 0; turn < turns; ++turn) {
        const int at = first + ring * (turns + 1) + turn, below = at + turns + 1;
        if (ring > 0) faces_.push_back({at, below, at + 1, material});
        if (ring + 1 < rings) faces_.push_back({at + 1, below, below + 1, material});
      }
  }
  /// Makes a store in `folder`.
  std::string Made(const TemporaryFolder& folder, const std::vector<Material>& materials) const {
    std::ofstream out(folder.file("m.ply"));
    out.precision(9);
    out << "ply\nformat ascii 1.0\nelement vertex " << vertices_.size();
    for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) out << "\nproperty float " << name;
    for (const char* name : {"red", "green", "blue"}) out << "\nproperty uchar " << name;
    out << "\nelement face " << faces_.size()
        << "\nproperty list uchar int vertex_indices\nproperty int material_index\nend_header\n";
    for (const auto& [at, normal, color] : vertices_)
      out << at.x << ' ' << at.y << ' ' << at.z << ' ' << normal.x << ' ' << normal.y << ' ' << normal.z
          << ' ' << color.x << ' ' << color.y << ' ' << color.z << '\n';
    for (const auto& [a, b, c, material] : faces_)
      out << "3 " << a << ' ' << b << ' ' << c << ' ' << material << '\n';
    out.close();
    std::ofstream library(folder.file("m.materials.json"));
    WriteMaterialJson({materials, {"part"}, {}, {}}, library);
    library.close();
    const std::string store = folder.file("scene.quarry");
    MakeStore({.models = {folder.file("m.ply")}, .output = store, .up_axis = 2});
    return store;
  }

 private:
  std::vector<Vertex> vertices_;
  std::vector<std::array<int, 4>> faces_;
};

Material Glass(float ior, float specular_ior, const glm::vec3& color) {
  Material m = White(0, 0, 1);
  m.transmission_weight = 1;
  m.transmission_color = color;
  m.ior = ior;
  m.specular_ior = specular_ior;
  m.diffuse = glm::vec3(0);
  m.transmittance = glm::vec3(0.8f);
  return m;
}

View CornellView() { return Looking({0, 1, 3.4}, {0, 1, 0}, 40, 64, 16); }

}  // namespace

TEST_CASE("An independent tracer sees the same Cornell box", "[reference][path]") {
  CompareModel("cornell/CornellBox-Original.obj", CornellView(), 2);
}

TEST_CASE("An independent tracer sees the same Cornell boxes of mirrors and glass",
          "[reference][path][.slow]") {
  for (const std::string box : {"Mirror", "Glossy", "Sphere", "Water"}) {
    View view = CornellView();
    view.spp = 32;
    view.bounces = box == "Water" ? 6 : 4;
    CompareModel("cornell/CornellBox-" + box + ".obj", view, 5);
  }
}

TEST_CASE("An independent tracer sees the same layers, metals, glass, panes and lights",
          "[reference][path]") {
  const TemporaryFolder folder;
  Shapes shapes;
  shapes.AddPlate(
      {-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0,
      {glm::ivec3(255, 80, 40), glm::ivec3(40, 255, 90), glm::ivec3(255), glm::ivec3(60, 70, 250)});
  std::vector<Material> materials(10);
  materials[0] = White(0.6f, 0, 1);  // a varnished floor of colours
  materials[1] = White(0.3f, 1, 0);
  materials[1].base_color = {0.9f, 0.6f, 0.3f};
  materials[2] = White(0.15f, 0, 0.8f);
  materials[2].base_color = {0.2f, 0.5f, 0.3f};
  materials[2].specular_color = {1, 0.7f, 0.8f};
  materials[2].specular_ior = 1.9f;
  materials[3] = White(0.9f, 0.4f, 1);  // half metal
  materials[3].base_color = {0.5f, 0.4f, 0.8f};
  materials[4] = White(0, 1, 0);  // a mirror
  materials[4].base_color = {0.9f, 0.95f, 0.8f};
  materials[5] = Glass(1.5f, 1.5f, {0.4f, 0.7f, 0.9f});
  materials[5].transmission_depth = 0.5f;
  materials[5].base_color = {0.9f, 1, 0.95f};
  materials[6] = Glass(1, 1.5f, {0.7f, 0.9f, 0.5f});  // a pane
  materials[6].transmission_weight = 0.8f;
  materials[7] = White(1, 0, 0);  // a veil
  materials[7].base_color = {0.8f, 0.3f, 0.3f};
  materials[7].geometry_opacity = 0.4f;
  materials[7].transmittance = glm::vec3(0.6f);
  materials[8].base_color = materials[8].diffuse = glm::vec3(0.5f);
  materials[8].emission = {3, 2, 1};  // a lamp
  materials[9] = White(0.05f, 0, 1);  // polish on a mirror's scale, and its body
  materials[9].specular_roughness = 0.02f;
  materials[9].base_color = {0.6f, 0.3f, 0.1f};
  for (int i = 0; i < 5; ++i)
    shapes.AddBall({-1.5 + 0.75 * i, -0.6 + 0.3 * (i % 2), 0.4}, 0.35, i == 4 ? 9 : i + 1);
  shapes.AddBall({-0.6, -1.5, 0.35}, 0.3, 5, 32);
  shapes.AddPlate({0.2, -1.9, 0.05}, {0.9, 0.3, 0}, {0, 0.1, 0.8}, 6);
  shapes.AddPlate({-1.8, -1.7, 0.1}, {0.7, 0, 0}, {0, 0.3, 0.7}, 7);
  shapes.AddPlate({-1, 1.2, 0.9}, {2, 0, 0}, {0, 0.2, 0.8}, 8);
  const std::string store = shapes.Made(folder, materials);
  View view = Looking({0.2, -4.6, 2.2}, {0, -0.5, 0.3}, 42, 64, 16);
  view.camera.up = {0.1, 0, 1};
  SECTION("under a sky") {
    view.sky.radiance = {0.5f, 0.6f, 0.9f};
    Compare("shapes, sky", store, view, 3);
  }
  SECTION("by a wide sun and rectangles, of which the eye sees one before the pane") {
    Light sun, lamp;
    sun.vector = glm::normalize(glm::vec3(0.4f, -0.5f, 0.8f));
    sun.radiance = glm::vec3(0.5f);
    sun.angle = 20;
    lamp.kind = LightKind::kRectangle;
    lamp.vector = {0.4f, -2.4f, 0.7f};
    lamp.edges[0] = {0.5f, 0, 0};
    lamp.edges[1] = {0, 0.1f, 0.4f};
    lamp.radiance = {0.6f, 0.8f, 1};
    view.lights = {sun, lamp};
    lamp.vector = {-2.2f, -1.5f, 1.5f};
    lamp.edges[0] = {0, 2, 0};
    lamp.edges[1] = {0.8f, 0, 1.2f};
    lamp.radiance = {1.5f, 1, 0.7f};
    view.lights.push_back(lamp);
    Compare("shapes, sun and rectangles", store, view, 3);
  }
}

TEST_CASE("An independent tracer sees the same Sponza", "[reference][path][.slow]") {
  View view = Looking({-900, 180, -40}, {200, 350, 20}, 60, 64, 16);
  Light sun;
  sun.vector = glm::normalize(glm::vec3(0.2f, 1, 0.15f));
  sun.angle = 4;
  sun.radiance = {3, 2.7f, 2.2f};
  view.lights = {sun};
  view.sky.radiance = {0.3f, 0.5f, 0.9f};
  CompareModel("sponza_crytek/sponza.obj", view, 3);
}

TEST_CASE("An independent tracer sees the same kitchen", "[reference][path][.slow]") {
  View view = Looking({1.211, 1.805, 3.852}, {-1.262, 1.570, -1.216}, 38, 64, 16);
  view.sky.radiance = {0.8f, 1, 1.2f};
  CompareModel("bitterli_country_kitchen/scene.obj.gz", view, 3);
}

}  // namespace quarry::test
