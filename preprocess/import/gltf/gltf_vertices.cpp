#include "preprocess/import/gltf/gltf_vertices.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_inverse.hpp>
#include <nlohmann/json.hpp>

#include "preprocess/import/gltf/gltf_material.h"

namespace quarry {
namespace {

using Json = nlohmann::json;
using Values = double[GltfAccessor::kMostComponents];

constexpr uint32_t kMostInfluences = 16;  // sets of four joints a vertex

/// Adds `weight` times the next element of `accessor`, if there is one, to `to`.
Status AddNext(std::optional<GltfAccessor>& accessor, double weight, glm::dvec3& to) {
  if (!accessor) return {};
  Values v;
  QUARRY_TRY(accessor->Next(v));
  to += weight * glm::dvec3(v[0], v[1], v[2]);
  return {};
}

uint8_t Byte(double x) { return static_cast<uint8_t>(x > 0 ? std::min(x, 1.0) * 255 + 0.5 : 0); }

}  // namespace

Result<GltfVertices> GltfVertices::Open(GltfDocument& document, const Json& primitive,
                                        const std::string& mesh, std::span<const double> weights,
                                        std::span<const glm::dmat4> joints, Wanted wanted) {
  GltfVertices vertices(document);
  vertices.alpha_ = wanted.alpha;
  vertices.mesh_ = mesh;
  const auto open = [&](const Json& attributes, const std::string& name, uint32_t least, uint32_t most,
                        std::optional<GltfAccessor>& accessor) -> Status {
    if (!attributes.contains(name)) return {};
    QUARRY_ASSIGN(const uint64_t index, document.Unsigned(attributes, mesh + ".attributes", name.c_str()));
    QUARRY_ASSIGN(accessor, GltfAccessor::Open(document, index, least, most));
    if (vertices.position_ && accessor->count() != vertices.count())
      return document.FailAt(
          fmt::format("{}: attributes of {} and of {} vertices", mesh, vertices.count(), accessor->count()));
    return {};
  };
  const Json& attributes = Member(primitive, "attributes");
  QUARRY_TRY(open(attributes, "POSITION", 3, 3, vertices.position_));
  QUARRY_TRY(open(attributes, "NORMAL", 3, 3, vertices.normal_));
  QUARRY_TRY(open(attributes, fmt::format("TEXCOORD_{}", wanted.uv_set), 2, 2, vertices.uv_));
  QUARRY_TRY(open(attributes, "COLOR_0", 3, 4, vertices.color_));
  for (uint32_t set = 0; !joints.empty() && set < kMostInfluences; ++set) {
    Influences influences;
    QUARRY_TRY(open(attributes, fmt::format("JOINTS_{}", set), 4, 4, influences.joints));
    QUARRY_TRY(open(attributes, fmt::format("WEIGHTS_{}", set), 4, 4, influences.weights));
    if (!influences.joints || !influences.weights) break;
    vertices.influences_.push_back(std::move(influences));
  }
  vertices.joints_ = joints;
  const auto targets = primitive.find("targets");
  if (targets == primitive.end() || !targets->is_array()) return vertices;
  for (size_t i = 0; i < std::min(weights.size(), targets->size()); ++i) {
    if (weights[i] == 0) continue;
    Target target{weights[i], {}, {}};
    QUARRY_TRY(open((*targets)[i], "POSITION", 3, 3, target.position));
    if (vertices.normal_) QUARRY_TRY(open((*targets)[i], "NORMAL", 3, 3, target.normal));
    vertices.targets_.push_back(std::move(target));
  }
  return vertices;
}

/// The matrix of the next vertex: the mean of its joints' matrices by weight.
Result<glm::dmat4> GltfVertices::Skinning() {
  glm::dmat4 sum(0);
  double total = 0;
  for (Influences& influences : influences_) {
    Values joint, weight;
    QUARRY_TRY(influences.joints->Next(joint));
    QUARRY_TRY(influences.weights->Next(weight));
    for (int k = 0; k < 4; ++k) {
      if (!(weight[k] > 0)) continue;
      if (!(joint[k] >= 0 && joint[k] < static_cast<double>(joints_.size())))
        return document_->FailAt(fmt::format("{}: a vertex is moved by joint {}, but there are only {}",
                                             mesh_, joint[k], joints_.size()));
      sum += joints_[static_cast<size_t>(joint[k])] * weight[k];
      total += weight[k];
    }
  }
  return total > 0 ? sum / total : glm::dmat4(1);
}

Result<GltfVertices::Vertex> GltfVertices::Next(const glm::dmat4& world, const glm::dmat3& turn) {
  Vertex vertex;
  Values v = {0, 0, 0, 1};
  if (color_) {
    QUARRY_TRY(color_->Next(v));
    vertex.color = {Byte(v[0]), Byte(v[1]), Byte(v[2]), alpha_ ? Byte(v[3]) : uint8_t{255}};
  }
  if (uv_) {
    QUARRY_TRY(uv_->Next(v));
    vertex.uv = {static_cast<float>(v[0]), static_cast<float>(v[1])};
  }
  glm::dvec3 position(0), normal(0);
  QUARRY_TRY(AddNext(position_, 1, position));
  QUARRY_TRY(AddNext(normal_, 1, normal));
  for (Target& target : targets_) {
    QUARRY_TRY(AddNext(target.position, target.weight, position));
    QUARRY_TRY(AddNext(target.normal, target.weight, normal));
  }
  if (skinned()) {
    QUARRY_ASSIGN(const glm::dmat4 moved, Skinning());
    vertex.position = glm::dvec3(moved * glm::dvec4(position, 1));
    if (normal_) normal = glm::inverseTranspose(glm::dmat3(moved)) * normal;
  } else {
    vertex.position = glm::dvec3(world * glm::dvec4(position, 1));
    if (normal_) normal = turn * normal;
  }
  const double length = std::sqrt(glm::dot(normal, normal));
  if (length > 0) vertex.normal = glm::vec3(normal / length);
  return vertex;
}

}  // namespace quarry
