#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "common/voxel/store_reader.h"
#include "common/voxel/store_writer.h"
#include "tests/support/stores/voxel_blocks.h"

namespace quarry::test {

/// A voxel of two triangles, a square of side 1, with a tree of two leaves. The caller sets ids, materials
/// and parts.
inline HotVoxel TwoTriangles() {
  HotVoxel v;
  v.cell = {glm::vec3(0), glm::vec3(1)};
  v.nodes = {KdNode::Inner(0, 0.5f, 1), KdNode::Leaf(0, 1), KdNode::Leaf(1, 2)};
  v.node_slots = 12;
  v.wide_nodes = 1;
  v.references = {0, 0, 1};
  v.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  v.corners = {0, 1, 2, 1, 3, 2};
  v.triangle_ids = {0, 1};
  v.materials = {0, 0};
  v.parts = {0, 0};
  return v;
}

/// The error when the store is opened and verified; empty for a sound store.
inline std::string FaultOf(const std::string& path) {
  const auto store = StoreReader::Open(path);
  if (!store) return store.error().message;
  const Status status = store->Verify([](uint64_t, uint64_t) {});
  return status ? "" : status.error().message;
}

/// Read or write a whole file.
inline std::vector<char> ReadFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
inline void WriteFile(const std::string& path, const std::vector<char>& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

/// Parts without parents, boxes and counts.
inline PartTable RootParts(std::vector<std::string> names) {
  const size_t count = names.size();
  return {std::move(names), std::vector<ScenePart>(count)};
}

/// Writes a store of `voxels` voxels in a chain. A block takes about 4 KiB and does not compress; every third
/// voxel has a shading block. Different seeds make different scenes.
inline void WriteSmallStore(const std::string& path, uint32_t voxels, uint32_t seed = 1) {
  constexpr uint32_t kVertices = 300;
  auto writer = StoreWriter::Create(path);
  REQUIRE(writer.has_value());
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> coordinate(0, 1);
  for (uint32_t v = 0; v < voxels; ++v) {
    HotVoxel hot = TwoTriangles();
    hot.vertices.clear();
    for (uint32_t i = 0; i < kVertices; ++i)
      hot.vertices.push_back({coordinate(random), coordinate(random), coordinate(random)});
    hot.triangle_ids = {2 * v, 2 * v + 1};
    ShadingVoxel shading;
    shading.corners = {0, 1, 0, 1, 1, 0};
    shading.vertices = {{{0, 0, 1}, {coordinate(random), 0.25f}, 0xFF0000FFu},
                        {{0, 1, 0}, {0, 1}, 0xFF00FF00u}};
    EncodedVoxel encoded = EncodeVoxel(hot, v % 3 == 0 ? &shading : nullptr);
    encoded.chained = v + 1 < voxels;
    REQUIRE(writer->AddVoxel(encoded).has_value());
  }
  SceneMeta meta;
  meta.bounds_upper = meta.root_upper = glm::vec3(1);
  meta.padding = 1e-6f;
  meta.input_triangles = 2 * voxels;
  meta.voxel_size = 1 << 16;
  REQUIRE(writer->Finish(meta, {KdNode::Leaf(0, 1)}, {Material{"paint"}}, RootParts({"part"})).has_value());
}

/// The keys of the directory's blocks.
inline std::vector<BlockKey> BlocksOf(const Catalog& catalog) {
  std::vector<BlockKey> blocks;
  for (uint32_t number = 0; number < catalog.block_numbers(); ++number)
    if (const auto block = catalog.BlockOf(number)) blocks.push_back(*block);
  return blocks;
}

}  // namespace quarry::test
