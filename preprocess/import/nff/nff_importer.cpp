// NFF (Haines, "Neutral File Format", 1988) and AFF, which BART adds to it (Lext, Assarsson & Moller, "BART:
// A Benchmark for Animated Ray Tracing", 2001): files included in one another, transforms, meshes. Animated
// transforms are taken at the animation's first moment. The view becomes a camera, lights become lights;
// images are left out.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <glm/common.hpp>
#include <glm/ext/matrix_transform.hpp>
#include <glm/geometric.hpp>
#include <glm/mat4x4.hpp>
#include <map>
#include <vector>

#include "common/scene/open_pbr.h"
#include "preprocess/import/find_file.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/nff/nff_views.h"
#include "preprocess/import/text/word_reader.h"
#include "preprocess/import/warn_once.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

constexpr int kMostIncludes = 32;    // files in one another
constexpr uint32_t kMeridians = 24;  // of spheres, cones and cylinders
constexpr uint32_t kParallels = 12;  // of spheres
constexpr uint64_t kTrianglesOfSphere = kMeridians * (2 * kParallels - 2), kTrianglesOfCone = 2 * kMeridians;
// Of all spheres and cones of a model: a few bytes of text become 528 triangles of some 50 bytes each on
// disk. This many take a minute or two and 2.5 GB of spill.
constexpr uint64_t kMostRoundTriangles = 50'000'000;
constexpr uint64_t kMostInMesh = 1u << 26;
constexpr double kPi = 3.14159265358979323846;

/// A value that changes with time, at the first moment.
struct Track {
  double values[4] = {0, 0, 0, 0};
  bool given = false;
};
struct Animation {
  Track translation, rotation, scale;

  glm::dmat4 Matrix() const {
    glm::dmat4 m(1);
    const auto vec = [](const Track& t) { return glm::dvec3(t.values[0], t.values[1], t.values[2]); };
    if (translation.given) m = glm::translate(m, vec(translation));
    if (rotation.given && glm::length(vec(rotation)) > 0)
      m = glm::rotate(m, rotation.values[3] * kPi / 180, glm::normalize(vec(rotation)));
    if (scale.given) m = glm::scale(m, vec(scale));
    return m;
  }
};

/// What a pass over a file and those that it includes shares.
struct Scene {
  Scene(ModelSink& s, const ModelReader& model)
      : sink(s), warn(s), folder(fs::path(model.path()).parent_path()), unpack_limit(model.unpack_limit()) {}
  ModelSink& sink;
  WarnOnce warn;
  const fs::path folder;  ///< of the model itself
  const uint64_t unpack_limit;
  bool animations_only = false;  ///< the first pass: animations come behind what they move
  double first_moment = 0;
  std::map<std::string, Animation> animations;
  std::vector<std::pair<Material, uint32_t>> materials;
  uint32_t material = kNoIndex;
  uint64_t positions = 0, normals = 0, uvs = 0, triangles = 0;
  uint64_t round_shapes = 0, round_triangles = 0;  ///< spheres and cones, and what they become
  bool images_left_out = false;
  NffViews views;
};

class NffFile {
 public:
  NffFile(ModelReader& bytes, Scene& scene, uint32_t part, int depth)
      : words_(bytes),
        folder_(fs::path(bytes.path()).parent_path()),
        scene_(scene),
        part_(part),
        depth_(depth) {}

  Status Read(const glm::dmat4& to_world) {
    transforms_.push_back(to_world);
    for (;;) {
      QUARRY_ASSIGN(const std::string_view next, words_.Peek());
      if (next.empty()) break;
      const std::string keyword(next);
      words_.Skip();
      QUARRY_TRY(Entity(keyword));
    }
    if (transforms_.size() > 1) return words_.FailHere("the file ends before a '}'");
    return {};
  }

 private:
  Status Entity(const std::string& keyword) {
    if (keyword == "f" || keyword == "fm") return Fill(keyword == "fm");
    if (keyword == "p" || keyword == "pp") return Polygon(keyword == "pp");
    if (keyword == "s") return Sphere();
    if (keyword == "c") return Cone();
    if (keyword == "m") return Mesh();
    if (keyword == "i") return Include();
    if (keyword == "xs") return StaticTransform();
    if (keyword == "x") return AnimatedTransform();
    if (keyword == "k") return KeyFrames();
    if (keyword == "a") return Animated();
    if (keyword == "}") {
      if (transforms_.size() < 2) return words_.FailHere("a '}' without its '{'");
      transforms_.pop_back();
      return {};
    }
    if (keyword == "l") return PointLight();
    if (keyword == "v") {
      if (scene_.views.views.size() <= kMaxSceneCameras) scene_.views.views.emplace_back();
      return SkipNumbers();
    }
    for (const char* known : {"from", "at", "up", "angle"})
      if (keyword == known) return ViewLine(keyword);
    for (const char* known : {"hither", "resolution", "b", "am"})
      if (keyword == known) return SkipNumbers();
    return words_.FailHere(fmt::format("{} is no entity of NFF or AFF that is read", Quoted(keyword)));
  }

  /// A line of the view at hand.
  Status ViewLine(const std::string& keyword) {
    if (scene_.views.views.empty()) scene_.views.views.emplace_back();
    NffView& view = scene_.views.views.back();
    if (keyword == "angle") {
      QUARRY_ASSIGN(view.angle, words_.Number("an angle"));
      return {};
    }
    QUARRY_ASSIGN(const glm::dvec3 v, Vec3("a point or direction of the view"));
    if (keyword == "up")
      view.up = glm::dvec3(transforms_.back() * glm::dvec4(v, 0));
    else
      (keyword == "from" ? view.from : view.at) = Point(v);
    return {};
  }

  /// "l [NAME] x y z [r g b]".
  Status PointLight() {
    NamedLight light;
    QUARRY_ASSIGN(const bool unnamed, words_.AtNumber());
    if (!unnamed) {
      QUARRY_ASSIGN(light.name, words_.Word("a light's name"));
    }
    QUARRY_ASSIGN(const glm::dvec3 position, Vec3("a light's position"));
    light.position = Point(position);
    light.radiance = glm::vec3(-1);  // until all are counted
    QUARRY_ASSIGN(const bool colored, words_.AtNumber());
    if (colored) {
      QUARRY_ASSIGN(const glm::dvec3 color, Vec3("a light's colour"));
      light.radiance = glm::max(glm::vec3(color), glm::vec3(0));
    }
    // One more than there may be, for the sink to warn of.
    if (scene_.views.lights.size() <= kMaxLights) scene_.views.lights.push_back(std::move(light));
    return SkipNumbers();
  }

  Status SkipNumbers() {
    for (;;) {
      QUARRY_ASSIGN(const bool number, words_.AtNumber());
      if (!number) return {};
      words_.Skip();
    }
  }

  Result<glm::dvec3> Vec3(const char* what) {
    glm::dvec3 v;
    for (int a = 0; a < 3; ++a) {
      QUARRY_ASSIGN(v[a], words_.Number(what));
    }
    return v;
  }

  /// f: colour, Kd, Ks, shine, transmittance, index of refraction. fm: ambient, diffuse and specular colours,
  /// then the same three numbers. What is specular is mirrored too, as in the original renderers.
  Status Fill(bool colors) {
    Material m;
    double numbers[5] = {1, 0, 0, 0, 1};
    glm::dvec3 diffuse, specular;
    if (colors) {
      QUARRY_TRY(Vec3("an ambient colour"));
      QUARRY_ASSIGN(diffuse, Vec3("a diffuse colour"));
      QUARRY_ASSIGN(specular, Vec3("a specular colour"));
    } else {
      QUARRY_ASSIGN(const glm::dvec3 color, Vec3("a colour"));
      for (int i = 0; i < 2; ++i) {
        QUARRY_ASSIGN(numbers[i], words_.Number("a coefficient"));
      }
      diffuse = color * numbers[0];
      specular = color * numbers[1];
    }
    for (int i = 2; i < 5; ++i) {
      QUARRY_ASSIGN(numbers[i], words_.Number("a shine, transmittance or index of refraction"));
    }
    const auto unit = [](double x) { return static_cast<float>(x > 0 ? std::min(x, 1.0) : 0.0); };
    for (int a = 0; a < 3; ++a) {
      m.diffuse[a] = unit(diffuse[a]);
      m.specular[a] = m.reflectance[a] = unit(specular[a]);
      m.transmittance[a] = unit(numbers[3]);
    }
    m.shininess = static_cast<float>(numbers[2] > 0 ? std::min(numbers[2], 10000.0) : 0.0);
    m.ior = static_cast<float>(numbers[4] > 1 ? std::min(numbers[4], 10.0) : 1.0);
    DeriveOpenPbr(m);
    if (scene_.animations_only) return {};
    const auto known = std::ranges::find(scene_.materials, m, &std::pair<Material, uint32_t>::first);
    if (known != scene_.materials.end()) {
      scene_.material = known->second;
      return {};
    }
    Material named = m;
    named.name = fmt::format("fill {}", scene_.materials.size() + 1);
    scene_.material = scene_.sink.AddMaterial(named);
    scene_.materials.emplace_back(m, scene_.material);
    return {};
  }

  glm::dvec3 Point(const glm::dvec3& p) const { return glm::dvec3(transforms_.back() * glm::dvec4(p, 1)); }
  glm::vec3 Normal(const glm::dvec3& n) const {
    // By the cofactors: the inverse's transpose, but for a factor.
    const glm::dmat3 m(transforms_.back());
    const glm::dvec3 moved =
        n.x * glm::cross(m[1], m[2]) + n.y * glm::cross(m[2], m[0]) + n.z * glm::cross(m[0], m[1]);
    const double length = glm::length(moved);
    return length > 0 ? glm::vec3(moved / length) : glm::vec3(0);
  }

  Status AddPosition(const glm::dvec3& p) {
    ++scene_.positions;
    return scene_.animations_only ? Status{} : scene_.sink.AddPosition(Point(p), {});
  }
  Status AddNormal(const glm::dvec3& n) {
    ++scene_.normals;
    return scene_.animations_only ? Status{} : scene_.sink.AddNormal(Normal(n));
  }
  Status AddPolygon(std::span<const Corner> corners) {
    if (corners.size() < 3 || scene_.animations_only) return {};
    scene_.triangles += corners.size() - 2;
    return scene_.sink.AddPolygon(corners, scene_.material, part_);
  }

  Status Polygon(bool normals) {
    QUARRY_ASSIGN(const uint32_t count, words_.Index("the number of corners", kMaxPolygonCorners));
    std::vector<Corner> corners;
    for (uint32_t i = 0; i < count; ++i) {
      corners.push_back({static_cast<uint32_t>(scene_.positions),
                         normals ? static_cast<uint32_t>(scene_.normals) : kNoIndex, kNoIndex});
      QUARRY_ASSIGN(const glm::dvec3 p, Vec3("a corner"));
      QUARRY_TRY(AddPosition(p));
      if (!normals) continue;
      QUARRY_ASSIGN(const glm::dvec3 n, Vec3("a normal"));
      QUARRY_TRY(AddNormal(n));
    }
    return AddPolygon(corners);
  }

  /// The first pass refuses too many before anything is made of them.
  Status CountRound(uint64_t triangles) {
    ++scene_.round_shapes;
    scene_.round_triangles += triangles;
    if (scene_.round_triangles <= kMostRoundTriangles) return {};
    return words_.FailHere(fmt::format(
        "its first {} spheres and cones become {} triangles ({} a sphere, {} a cone), and at most {} are "
        "made; give fewer a model, or meshes of your own",
        scene_.round_shapes, scene_.round_triangles, kTrianglesOfSphere, kTrianglesOfCone,
        kMostRoundTriangles));
  }

  /// Rows of kMeridians points each, with normals, joined by quads; corners that coincide at poles give none.
  template <class At>
  Status Grid(uint32_t rows, At&& at) {
    QUARRY_TRY(CountRound(rows > 1 ? kTrianglesOfSphere : kTrianglesOfCone));
    if (scene_.animations_only) return {};
    const auto first = static_cast<uint32_t>(scene_.positions),
               first_normal = static_cast<uint32_t>(scene_.normals);
    for (uint32_t row = 0; row <= rows; ++row)
      for (uint32_t i = 0; i < kMeridians; ++i) {
        const auto [point, normal] = at(row, 2 * kPi * i / kMeridians);
        QUARRY_TRY(AddPosition(point));
        QUARRY_TRY(AddNormal(normal));
      }
    for (uint32_t row = 0; row < rows; ++row)
      for (uint32_t i = 0; i < kMeridians; ++i) {
        const uint32_t next = (i + 1) % kMeridians;
        Corner corners[4];
        uint32_t k = 0;
        for (const uint32_t at_index : {row * kMeridians + i, row * kMeridians + next,
                                        (row + 1) * kMeridians + next, (row + 1) * kMeridians + i})
          corners[k++] = {first + at_index, first_normal + at_index, kNoIndex};
        if (rows > 1 && row == 0) {
          const Corner triangle[] = {corners[0], corners[2], corners[3]};
          QUARRY_TRY(AddPolygon(triangle));
        } else if (rows > 1 && row + 1 == rows) {
          QUARRY_TRY(AddPolygon(std::span(corners).first(3)));
        } else {
          QUARRY_TRY(AddPolygon(corners));
        }
      }
    return {};
  }

  Status Sphere() {
    QUARRY_ASSIGN(const glm::dvec3 center, Vec3("a centre"));
    QUARRY_ASSIGN(const double radius, words_.Number("a radius"));
    return Grid(kParallels, [&](uint32_t row, double angle) {
      const double tilt = kPi * row / kParallels;
      const glm::dvec3 n(std::sin(tilt) * std::cos(angle), std::sin(tilt) * std::sin(angle), std::cos(tilt));
      return std::pair(center + radius * n, n);
    });
  }

  /// Open at both ends.
  Status Cone() {
    glm::dvec3 ends[2];
    double radii[2];
    for (int i = 0; i < 2; ++i) {
      QUARRY_ASSIGN(ends[i], Vec3("the end of a cone"));
      QUARRY_ASSIGN(radii[i], words_.Number("a radius"));
    }
    const glm::dvec3 axis = ends[1] - ends[0];
    const double length = glm::length(axis);
    if (!(length > 0)) return words_.FailHere("a cone whose ends coincide");
    const glm::dvec3 w = axis / length;
    const glm::dvec3 u =
        glm::normalize(glm::cross(w, std::fabs(w.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0)));
    const glm::dvec3 v = glm::cross(w, u);
    return Grid(1, [&](uint32_t row, double angle) {
      const glm::dvec3 around = std::cos(angle) * u + std::sin(angle) * v;
      return std::pair(ends[row] + radii[row] * around, around * length + w * (radii[0] - radii[1]));
    });
  }

  Status Mesh() {
    uint64_t counts[3] = {0, 0, 0};  // of vertices, normals, texture coordinates
    const uint64_t first[3] = {scene_.positions, scene_.normals, scene_.uvs};
    for (;;) {
      QUARRY_ASSIGN(const std::string kind,
                    words_.Word("\"vertices\", \"normals\", \"texturecoords\" or \"triangles\""));
      QUARRY_ASSIGN(const uint32_t count, words_.Index("a count", kMostInMesh));
      if (kind == "triangles") return Triangles(count, counts, first);
      if (kind == "texturecoords") {
        QUARRY_TRY(words_.Word("an image's name"));
        scene_.images_left_out = true;
      }
      for (uint32_t i = 0; i < count; ++i) {
        if (kind == "vertices" || kind == "normals") {
          QUARRY_ASSIGN(const glm::dvec3 v, Vec3("a vertex or normal"));
          QUARRY_TRY(kind == "vertices" ? AddPosition(v) : AddNormal(v));
        } else if (kind == "texturecoords") {
          QUARRY_ASSIGN(const double u, words_.Number("a texture coordinate"));
          QUARRY_ASSIGN(const double v, words_.Number("a texture coordinate"));
          ++scene_.uvs;
          if (!scene_.animations_only) QUARRY_TRY(scene_.sink.AddUv(glm::vec2(u, v)));
        } else {
          return words_.FailHere(fmt::format("{} in a mesh", Quoted(kind)));
        }
      }
      counts[kind == "vertices" ? 0 : kind == "normals" ? 1 : 2] = count;
    }
  }

  /// Of each triangle three vertices, then three normals and three texture coordinates, as far as there are.
  Status Triangles(uint32_t count, const uint64_t counts[3], const uint64_t first[3]) {
    for (uint32_t i = 0; i < count; ++i) {
      uint32_t indices[3][3];
      for (int kind = 0; kind < 3; ++kind)
        for (uint32_t& index : indices[kind]) {
          index = kNoIndex;
          if (counts[kind] == 0) continue;
          QUARRY_ASSIGN(const uint32_t at, words_.Index("an index", counts[kind] - 1));
          index = static_cast<uint32_t>(first[kind] + at);
        }
      Corner corners[3];
      for (int k = 0; k < 3; ++k) corners[k] = {indices[0][k], indices[1][k], indices[2][k]};
      QUARRY_TRY(AddPolygon(corners));
    }
    return {};
  }

  /// Its number tells whether shadows are cast, of no matter here.
  Status Include() {
    QUARRY_TRY(words_.Number("the number before an included file"));
    QUARRY_ASSIGN(const std::string name, words_.Word("a file's name"));
    if (depth_ == kMostIncludes)
      return words_.FailHere(fmt::format("{} files included in one another are too many", kMostIncludes));
    auto bytes = ModelReader::Open((folder_ / name).string(), scene_.unpack_limit);
    if (LeavesFolder(scene_.folder, folder_ / name))
      scene_.warn(words_
                      .FailHere(fmt::format("names the file {}, outside the model's folder; it is read",
                                            (folder_ / name).string()))
                      .value()
                      .message);
    if (!bytes) return words_.FailHere(bytes.error().message);
    const uint32_t part = scene_.animations_only ? 0 : scene_.sink.AddPart(fs::path(name).stem().string());
    return NffFile(*bytes, scene_, part, depth_ + 1).Read(transforms_.back());
  }

  Status Open(const glm::dmat4& local) {
    QUARRY_ASSIGN(const std::string brace, words_.Word("a '{'"));
    if (brace != "{") return words_.FailHere(fmt::format("a '{{' should be here, not {}", Quoted(brace)));
    if (transforms_.size() > 1000)
      return words_.FailHere("a thousand transforms in one another are too many");
    transforms_.push_back(transforms_.back() * local);
    return {};
  }

  Status StaticTransform() {
    Animation a;
    QUARRY_ASSIGN(const glm::dvec3 scale, Vec3("a factor"));
    QUARRY_ASSIGN(const glm::dvec3 axis, Vec3("an axis"));
    QUARRY_ASSIGN(const double angle, words_.Number("an angle"));
    QUARRY_ASSIGN(const glm::dvec3 translation, Vec3("a translation"));
    a.scale = {{scale.x, scale.y, scale.z, 0}, true};
    a.rotation = {{axis.x, axis.y, axis.z, angle}, true};
    a.translation = {{translation.x, translation.y, translation.z, 0}, true};
    return Open(a.Matrix());
  }

  Status AnimatedTransform() {
    QUARRY_ASSIGN(const std::string name, words_.Word("the name of an animation"));
    const auto found = scene_.animations.find(name);
    return Open(found == scene_.animations.end() ? glm::dmat4(1) : found->second.Matrix());
  }

  Status Animated() {
    double numbers[3];
    for (double& number : numbers) {
      QUARRY_ASSIGN(number, words_.Number("a time or a number of frames"));
    }
    scene_.first_moment = numbers[0];
    return {};
  }

  Status KeyFrames() {
    QUARRY_ASSIGN(const std::string name, words_.Word("the name of an animation"));
    QUARRY_ASSIGN(const std::string brace, words_.Word("a '{'"));
    if (brace != "{") return words_.FailHere(fmt::format("a '{{' should be here, not {}", Quoted(brace)));
    Animation animation;
    for (;;) {
      QUARRY_ASSIGN(const std::string kind, words_.Word("a '}'"));
      if (kind == "}") break;
      QUARRY_ASSIGN(const uint32_t count, words_.Index("the number of keys", kMostInMesh));
      if (kind == "transl")
        QUARRY_TRY(ReadTrack(count, 3, animation.translation));
      else if (kind == "scale")
        QUARRY_TRY(ReadTrack(count, 3, animation.scale));
      else if (kind == "rot")
        QUARRY_TRY(ReadTrack(count, 4, animation.rotation));
      else if (kind == "visibility")
        for (uint32_t i = 0; i < 2 * count; ++i) QUARRY_TRY(words_.Number("a key"));
      else
        return words_.FailHere(fmt::format("{} is no animation that is read", Quoted(kind)));
    }
    scene_.animations[name] = animation;
    return {};
  }

  /// Between keys along a straight line: their tension, continuity and bias are of no matter at the first
  /// moment of scenes that rest then.
  Status ReadTrack(uint32_t count, int values, Track& track) {
    double before_time = 0;
    bool passed = false;
    for (uint32_t i = 0; i < count; ++i) {
      QUARRY_ASSIGN(const double time, words_.Number("the time of a key"));
      double key[4] = {0, 0, 0, 0};
      for (int k = 0; k < values; ++k) {
        QUARRY_ASSIGN(key[k], words_.Number("a key"));
      }
      QUARRY_TRY(Vec3("tension, continuity or bias"));
      if (passed) continue;
      const bool beyond = time > scene_.first_moment;
      const double part = track.given && beyond && time > before_time
                              ? (scene_.first_moment - before_time) / (time - before_time)
                              : 1;
      for (int k = 0; k < 4; ++k) track.values[k] = (1 - part) * track.values[k] + part * key[k];
      track.given = true;
      before_time = time;
      passed = beyond;
    }
    return {};
  }

  WordReader words_;
  fs::path folder_;
  Scene& scene_;
  uint32_t part_;
  int depth_;
  std::vector<glm::dmat4> transforms_;
};

}  // namespace

bool LooksLikeNff(ModelReader& bytes) {
  bytes.Ensure(4096);
  std::string_view text = bytes.view().substr(0, 4096);
  // The first word that is no comment: a view, a background or a light, which other formats do not begin
  // with.
  while (!text.empty()) {
    TextCursor line(text.substr(0, text.find('\n')));
    text.remove_prefix(
        std::min(text.size(), text.find('\n') == text.npos ? text.size() : text.find('\n') + 1));
    if (line.AtEnd() || *line.next == '%') continue;
    const std::string_view word = line.Word();
    double ignored;
    if (word == "b") return ParseReal(line, ignored);
    return word == "v" && line.AtEnd();
  }
  return false;
}

Result<uint64_t> ImportNff(ModelReader& bytes, ModelSink& sink) {
  Scene scene(sink, bytes);
  if (bytes.can_reopen()) {
    scene.animations_only = true;
    QUARRY_ASSIGN(ModelReader again, ModelReader::Open(bytes.path(), bytes.unpack_limit()));
    QUARRY_TRY(NffFile(again, scene, kNoIndex, 0).Read(glm::dmat4(1)));
    scene.animations_only = false;
    scene.views = {};
    scene.positions = scene.normals = scene.uvs = scene.round_shapes = scene.round_triangles = 0;
  }
  QUARRY_TRY(NffFile(bytes, scene, kNoIndex, 0).Read(glm::dmat4(1)));
  GiveViews(std::move(scene.views), sink);
  if (scene.images_left_out) sink.Warn(fmt::format("{}: its images are left out", bytes.path()));
  return scene.triangles;
}

}  // namespace quarry
