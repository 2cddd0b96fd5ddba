// NFF (Haines, "Neutral File Format", 1988) and AFF, BART's extension of it (Lext, Assarsson & Moller, "BART:
// A Benchmark for Animated Ray Tracing", 2001): included files, transforms, meshes. Animated transforms are
// taken at the animation's first moment. The view becomes a camera, lights become lights; images are left
// out.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <glm/common.hpp>
#include <vector>

#include "common/scene/open_pbr.h"
#include "preprocess/import/files/find_file.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/nff/nff_shapes.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

constexpr int kMostIncludes = 32;  // depth of files included in one another

class NffReader {
 public:
  NffReader(ModelReader& bytes, NffScene& scene, uint32_t part, int depth)
      : file_(bytes, scene, part), path_(bytes.path()), depth_(depth) {}

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
    if (keyword == "p" || keyword == "pp") return ReadNffPolygon(file_, keyword == "pp");
    if (keyword == "s") return ReadNffSphere(file_);
    if (keyword == "c") return ReadNffCone(file_);
    if (keyword == "m") return ReadNffMesh(file_);
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
    return words_.FailHere(fmt::format("{} is not an entity of NFF or AFF that is read", Quoted(keyword)));
  }

  /// A line of the current view.
  Status ViewLine(const std::string& keyword) {
    if (scene_.views.views.empty()) scene_.views.views.emplace_back();
    NffView& view = scene_.views.views.back();
    if (keyword == "angle") {
      QUARRY_ASSIGN(view.angle, words_.Number("an angle"));
      return {};
    }
    QUARRY_ASSIGN(const glm::dvec3 v, file_.Vec3("a point or direction of the view"));
    if (keyword == "up")
      view.up = glm::dvec3(transforms_.back() * glm::dvec4(v, 0));
    else
      (keyword == "from" ? view.from : view.at) = file_.Point(v);
    return {};
  }

  /// "l [NAME] x y z [r g b]".
  Status PointLight() {
    NamedLight light;
    QUARRY_ASSIGN(const bool unnamed, words_.AtNumber());
    if (!unnamed) {
      QUARRY_ASSIGN(light.name, words_.Word("a light's name"));
    }
    QUARRY_ASSIGN(const glm::dvec3 position, file_.Vec3("a light's position"));
    light.position = file_.Point(position);
    light.radiance = glm::vec3(-1);  // until all lights are counted
    QUARRY_ASSIGN(const bool colored, words_.AtNumber());
    if (colored) {
      QUARRY_ASSIGN(const glm::dvec3 color, file_.Vec3("a light's colour"));
      light.radiance = glm::max(glm::vec3(color), glm::vec3(0));
    }
    // One more than the limit, so that the sink warns.
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

  /// f: colour, Kd, Ks, shine, transmittance, index of refraction. fm: ambient, diffuse and specular colours,
  /// then the last three numbers. A specular colour also mirrors, as in the original renderers.
  Status Fill(bool colors) {
    Material m;
    double numbers[5] = {1, 0, 0, 0, 1};
    glm::dvec3 diffuse, specular;
    if (colors) {
      QUARRY_TRY(file_.Vec3("an ambient colour"));
      QUARRY_ASSIGN(diffuse, file_.Vec3("a diffuse colour"));
      QUARRY_ASSIGN(specular, file_.Vec3("a specular colour"));
    } else {
      QUARRY_ASSIGN(const glm::dvec3 color, file_.Vec3("a colour"));
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

  /// The number states whether shadows are cast; Quarry ignores it.
  Status Include() {
    QUARRY_TRY(words_.Number("the number before an included file"));
    QUARRY_ASSIGN(const std::string name, words_.Word("a file's name"));
    if (depth_ == kMostIncludes)
      return words_.FailHere(fmt::format("{} nested included files are too many", kMostIncludes));
    const fs::path found = FindFile(path_, name);
    const fs::path file = found.empty() ? fs::path(path_).parent_path() / name : found;
    auto bytes = ModelReader::Open(file.string(), scene_.unpack_limit);
    if (LeavesFolder(scene_.path, file))
      scene_.warn(words_
                      .FailHere(fmt::format(
                          "names the file {}, outside the model's folder; it is read anyway", file.string()))
                      .value()
                      .message);
    if (!bytes) return words_.FailHere(bytes.error().message);
    const uint32_t part =
        scene_.animations_only ? 0 : scene_.sink.AddPart(fs::path(name).stem().string(), kNoIndex);
    return NffReader(*bytes, scene_, part, depth_ + 1).Read(transforms_.back());
  }

  Status Open(const glm::dmat4& local) {
    QUARRY_ASSIGN(const std::string brace, words_.Word("a '{'"));
    if (brace != "{") return words_.FailHere(fmt::format("a '{{' should be here, not {}", Quoted(brace)));
    if (transforms_.size() > 1000) return words_.FailHere("a thousand nested transforms are too many");
    transforms_.push_back(transforms_.back() * local);
    return {};
  }

  Status StaticTransform() {
    NffAnimation a;
    QUARRY_ASSIGN(const glm::dvec3 scale, file_.Vec3("a factor"));
    QUARRY_ASSIGN(const glm::dvec3 axis, file_.Vec3("an axis"));
    QUARRY_ASSIGN(const double angle, words_.Number("an angle"));
    QUARRY_ASSIGN(const glm::dvec3 translation, file_.Vec3("a translation"));
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
    NffAnimation animation;
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
        return words_.FailHere(fmt::format("{} is not an animation that is read", Quoted(kind)));
    }
    scene_.animations[name] = animation;
    return {};
  }

  /// Interpolates linearly between keys: tension, continuity and bias have no effect at the first moment of
  /// scenes that rest then.
  Status ReadTrack(uint32_t count, int values, NffTrack& track) {
    double before_time = 0;
    bool passed = false;
    for (uint32_t i = 0; i < count; ++i) {
      QUARRY_ASSIGN(const double time, words_.Number("the time of a key"));
      double key[4] = {0, 0, 0, 0};
      for (int k = 0; k < values; ++k) {
        QUARRY_ASSIGN(key[k], words_.Number("a key"));
      }
      QUARRY_TRY(file_.Vec3("tension, continuity or bias"));
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

  NffFile file_;
  WordReader& words_ = file_.words;
  NffScene& scene_ = file_.scene;
  std::vector<glm::dmat4>& transforms_ = file_.transforms;
  std::string path_;
  int depth_;
};

}  // namespace

bool LooksLikeNff(ModelReader& bytes) {
  constexpr size_t kLook = 1 << 16;  // comments may be long
  bytes.Ensure(kLook);
  std::string_view text = bytes.view().substr(0, kLook);
  // The first word that is no comment: a view, a background or a light, with which no other format begins.
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
  NffScene scene(sink, bytes);
  if (bytes.can_reopen()) {
    scene.animations_only = true;
    QUARRY_ASSIGN(ModelReader again, ModelReader::Open(bytes.path(), bytes.unpack_limit()));
    QUARRY_TRY(NffReader(again, scene, kNoIndex, 0).Read(glm::dmat4(1)));
    scene.animations_only = false;
    scene.views = {};
    scene.positions = scene.normals = scene.uvs = scene.round_shapes = scene.round_triangles = 0;
  }
  QUARRY_TRY(NffReader(bytes, scene, kNoIndex, 0).Read(glm::dmat4(1)));
  GiveViews(std::move(scene.views), sink);
  if (scene.images_left_out) sink.Warn(fmt::format("{}: its images are left out", bytes.path()));
  return scene.triangles;
}

}  // namespace quarry
