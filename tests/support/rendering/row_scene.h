#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <vector>

#include "common/engine/scene.h"
#include "common/voxel/store_writer.h"
#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry::test {

/// A voxel of two triangles, with the cell from y to y + 10 along y and from -20 to 20 across.
inline HotVoxel RowVoxel(float y, const std::vector<glm::vec3>& vertices, uint32_t first_id) {
  HotVoxel v;
  v.cell = {{-20, y, -20}, {20, y + 10, 20}};
  v.nodes = {KdNode::Leaf(0, 2)};
  v.node_slots = 4;
  v.wide_nodes = 1;
  v.references = {0, 1};
  v.vertices = vertices;
  v.corners = {0, 1, 2, 3, 4, 5};
  v.triangle_ids = {first_id, first_id + 1};
  v.materials = {0, 0};
  v.parts = {0, 0};
  return v;
}

/// A voxel with small triangles in two corners of the cell, which rays pass through.
inline HotVoxel OpenVoxel(float y, uint32_t first_id) {
  return RowVoxel(
      y, {{-20, y, -20}, {-19, y, -20}, {-20, y, -19}, {20, y + 10, 20}, {19, y + 10, 20}, {20, y + 10, 19}},
      first_id);
}

/// Writes a store of four voxels in a row along y, from -10 to 30. The third has a wall at 15, a mirror with
/// attributes.
struct Row {
  explicit Row(uint16_t material = 0) {
    auto writer = StoreWriter::Create(folder.file("s"));
    REQUIRE(writer.has_value());
    const std::vector<glm::vec3> wall{{-20, 15, -20}, {20, 15, -20}, {20, 15, 20},
                                      {-20, 15, -20}, {20, 15, 20},  {-20, 15, 20}};
    ShadingVoxel shading;
    shading.corners = {0, 0, 0, 0, 0, 0};
    shading.vertices = {{{0, -1, 0}, {0, 0}, 0xFFFFFFFFu}};
    for (uint32_t v = 0; v < 4; ++v) {
      const float y = 10 * static_cast<float>(v) - 10;
      HotVoxel hot = v == 2 ? RowVoxel(y, wall, 2 * v) : OpenVoxel(y, 2 * v);
      if (v == 2) hot.materials[0] = material;
      REQUIRE(writer->AddVoxel(EncodeVoxel(hot, v == 2 ? &shading : nullptr)).has_value());
    }
    SceneMeta meta;
    meta.bounds_lower = meta.root_lower = {-20, -10, -20};
    meta.bounds_upper = meta.root_upper = {20, 30, 20};
    meta.padding = 1e-4f;
    meta.input_triangles = 8;
    meta.voxel_size = 1 << 16;
    Material mirror{"mirror"};
    mirror.reflectance = glm::vec3(1);
    REQUIRE(writer
                ->Finish(meta,
                         {KdNode::Inner(1, 10, 1), KdNode::Inner(1, 0, 3), KdNode::Inner(1, 20, 5),
                          KdNode::Leaf(0, 1), KdNode::Leaf(1, 1), KdNode::Leaf(2, 1), KdNode::Leaf(3, 1)},
                         {mirror}, RootParts({"part"}))
                .has_value());
    auto opened = Scene::Open(folder.file("s"));
    REQUIRE(opened.has_value());
    scene.emplace(std::move(*opened));
  }
  uint64_t largest() const { return scene->catalog().meta.largest_decoded; }

  TemporaryFolder folder;
  std::optional<Scene> scene;
};

}  // namespace quarry::test
