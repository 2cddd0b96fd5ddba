#pragma once

#include <cstdint>
#include <glm/ext/matrix_transform.hpp>
#include <glm/geometric.hpp>
#include <glm/mat4x4.hpp>
#include <map>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "preprocess/import/model_sink.h"
#include "preprocess/import/nff/nff_views.h"
#include "preprocess/import/text/word_reader.h"
#include "preprocess/import/warn_once.h"

namespace quarry {

inline constexpr uint64_t kMostInMesh = 1u << 26;  ///< most elements of an array in the text

/// An animated value at the animation's first moment.
struct NffTrack {
  double values[4] = {0, 0, 0, 0};
  bool given = false;
};
struct NffAnimation {
  NffTrack translation, rotation, scale;

  glm::dmat4 Matrix() const {
    glm::dmat4 m(1);
    const auto vec = [](const NffTrack& t) { return glm::dvec3(t.values[0], t.values[1], t.values[2]); };
    if (translation.given) m = glm::translate(m, vec(translation));
    if (rotation.given && glm::length(vec(rotation)) > 0)
      m = glm::rotate(m, rotation.values[3] * std::numbers::pi / 180, glm::normalize(vec(rotation)));
    if (scale.given) m = glm::scale(m, vec(scale));
    return m;
  }
};

/// The state that a file shares with the files it includes, during a pass.
struct NffScene {
  NffScene(ModelSink& s, const ModelReader& model)
      : sink(s), warn(s), path(model.path()), unpack_limit(model.unpack_limit()) {}
  ModelSink& sink;
  WarnOnce warn;
  const std::string path;  ///< of the main file
  const uint64_t unpack_limit;
  bool animations_only = false;  ///< first pass: animations may follow the objects they move
  double first_moment = 0;
  std::map<std::string, NffAnimation> animations;
  std::vector<std::pair<Material, uint32_t>> materials;
  uint32_t material = kNoIndex;
  uint64_t positions = 0, normals = 0, uvs = 0, triangles = 0;
  uint64_t round_shapes = 0, round_triangles = 0;  ///< spheres and cones so far, and their triangles
  bool images_left_out = false;
  NffViews views;
};

/// A file that is being read: its words and the transforms around the current place.
struct NffFile {
  NffFile(ModelReader& bytes, NffScene& in, uint32_t file_part) : words(bytes), scene(in), part(file_part) {}

  Result<glm::dvec3> Vec3(const char* what) {
    glm::dvec3 v;
    for (int a = 0; a < 3; ++a) {
      QUARRY_ASSIGN(v[a], words.Number(what));
    }
    return v;
  }
  /// Both transform to world coordinates. A normal is transformed by the cofactors: the inverse's transpose
  /// but for a factor.
  glm::dvec3 Point(const glm::dvec3& p) const { return glm::dvec3(transforms.back() * glm::dvec4(p, 1)); }
  glm::vec3 Normal(const glm::dvec3& n) const {
    const glm::dmat3 m(transforms.back());
    const glm::dvec3 moved =
        n.x * glm::cross(m[1], m[2]) + n.y * glm::cross(m[2], m[0]) + n.z * glm::cross(m[0], m[1]);
    const double length = glm::length(moved);
    return length > 0 ? glm::vec3(moved / length) : glm::vec3(0);
  }

  WordReader words;
  NffScene& scene;
  uint32_t part;
  std::vector<glm::dmat4> transforms;  ///< the current transform last
};

}  // namespace quarry
