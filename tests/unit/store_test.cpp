#include <unistd.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "common/kdtree/treelets.h"
#include "common/voxel/store_format.h"
#include "common/voxel/store_reader.h"
#include "common/voxel/store_writer.h"

namespace quarry {
namespace {

struct Folder {
  Folder() { std::filesystem::create_directories(path); }
  ~Folder() { std::filesystem::remove_all(path); }
  std::string path =
      (std::filesystem::temp_directory_path() / ("quarry-store-" + std::to_string(::getpid()))).string();
  std::string file(const std::string& name) const { return path + "/" + name; }
};

HotVoxel MakeHot() {
  HotVoxel v;
  v.cell = {glm::vec3(0), glm::vec3(1)};
  v.nodes = LayOutTreelets(std::vector{KdNode::Inner(0, 0.5f, 1), KdNode::Leaf(0, 1), KdNode::Leaf(1, 2)},
                           kTreeletLevels);
  v.wide_nodes = 1;
  v.references = {0, 0, 1};
  v.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  v.corners = {0, 1, 2, 1, 3, 2};
  v.triangle_ids = {7, 8};
  v.materials = {0, 1};
  v.parts = {0, 1};
  return v;
}

ShadingVoxel MakeShading() {
  ShadingVoxel v;
  v.corners = {0, 1, 0, 1, 1, 0};
  v.vertices = {{{0, 0, 1}, {0.5f, 0.25f}, 0xFF0000FFu}, {{0, 1, 0}, {0, 1}, 0xFF00FF00u}};
  return v;
}

SceneMeta MakeMeta() {
  SceneMeta m;
  m.bounds_upper = m.root_upper = glm::vec3(1);
  m.padding = 1e-6f;
  m.up_axis = 1;
  m.offset = {1, 2, 3};
  m.unit_in_metres = 0.001;
  m.input_triangles = 9;
  m.dropped_degenerate = 3;
  m.dropped_not_finite = 4;
  m.voxel_size = 4096;
  return m;
}

std::vector<Material> MakeMaterials() {
  Material steel{"steel"};
  steel.reflectance = {0.1f, 0.2f, 0.3f};
  steel.emission = {1, 2, 3};
  steel.shininess = 50;
  steel.ior = 1.5f;
  steel.fresnel = true;
  return {Material{"paint"}, steel};
}

SceneId WriteStore(const std::string& path) {
  auto writer = StoreWriter::Create(path);
  REQUIRE(writer.has_value());
  EncodedVoxel first = EncodeVoxel(LayOutHot(MakeHot()), LayOutShading(MakeShading()), 2);
  first.chained = true;
  REQUIRE(writer->AddVoxel(first).has_value());
  REQUIRE(writer->AddVoxel(EncodeVoxel(LayOutHot(MakeHot()), {}, 2)).has_value());
  const auto id = writer->Finish(MakeMeta(), {KdNode::Leaf(0, 1)}, MakeMaterials(), {"valve", "pump"});
  REQUIRE(id.has_value());
  return *id;
}

std::vector<char> ReadFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void WriteFile(const std::string& path, const std::vector<char>& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

/// The sentence of whatever goes wrong when the store is opened and read whole; empty when nothing does.
std::string Fault(const std::string& path) {
  const auto store = StoreReader::Open(path);
  if (!store) return store.error().message;
  const Status status = store->Verify([](uint64_t, uint64_t) {});
  return status ? "" : status.error().message;
}

}  // namespace

TEST_CASE("A store gives back all that was put in") {
  const Folder folder;
  const SceneId id = WriteStore(folder.file("s"));
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store.has_value());
  CHECK(Fault(folder.file("s")).empty());
  const Catalog& c = store->catalog();
  CHECK(c.id == id);
  SceneMeta expected = MakeMeta();
  expected.stored_references = 4;
  expected.largest_decoded = c.meta.largest_decoded;
  expected.largest_stored = c.meta.largest_stored;
  expected.lz4_version = c.meta.lz4_version;
  CHECK(c.meta == expected);
  CHECK(FlattenTreelets(c.top_nodes) == std::vector<KdNode>{KdNode::Leaf(0, 1)});
  CHECK(c.top_node_count == 1);
  REQUIRE(c.voxels.size() == 2);
  CHECK(c.voxels[0].next_in_chain == 1);
  CHECK(c.voxels[1].next_in_chain == kNoIndex);
  CHECK(c.voxels[1].blocks[1].stored == 0);
  CHECK(store->parts() == std::vector<std::string>{"valve", "pump"});
  CHECK(store->material_names() == std::vector<std::string>{"paint", "steel"});
  auto materials = MakeMaterials();
  for (Material& m : materials) m.name.clear();
  CHECK(c.materials == materials);

  const auto stored = store->ReadBlock(BlockId(0, BlockKind::kHot));
  REQUIRE(stored.has_value());
  Bytes decoded(c.block(0).decoded);
  REQUIRE(DecompressBlock(*stored, decoded).has_value());
  CHECK(decoded == LayOutHot(MakeHot()));
  CHECK_FALSE(store->ReadBlock(99).has_value());
}

TEST_CASE("Every byte of a store that is flipped is found") {
  const Folder folder;
  WriteStore(folder.file("s"));
  const auto good = ReadFile(folder.file("s"));
  for (size_t at = 0; at < good.size(); ++at) {
    auto bad = good;
    bad[at] = static_cast<char>(bad[at] ^ (1 << at % 8));
    WriteFile(folder.file("bad"), bad);
    INFO("byte " << at);
    const std::string fault = Fault(folder.file("bad"));
    CHECK(fault.find("bad: ") != std::string::npos);
  }
}

TEST_CASE("Truncated stores are refused at every length") {
  const Folder folder;
  WriteStore(folder.file("s"));
  auto bytes = ReadFile(folder.file("s"));
  while (!bytes.empty()) {
    bytes.pop_back();
    WriteFile(folder.file("bad"), bytes);
    REQUIRE_FALSE(Fault(folder.file("bad")).empty());
  }
}

TEST_CASE("Another format version is named beside this one") {
  const Folder folder;
  WriteStore(folder.file("s"));
  for (uint32_t version : {0u, kStoreVersion + 1}) {
    auto bytes = ReadFile(folder.file("s"));
    std::memcpy(bytes.data() + 8, &version, 4);
    const uint64_t checksum = Checksum(std::as_bytes(std::span(bytes).first(56)));
    std::memcpy(bytes.data() + 56, &checksum, 8);
    WriteFile(folder.file("other"), bytes);
    const std::string fault = Fault(folder.file("other"));
    CHECK(fault.find("version " + std::to_string(version) + ", this program reads version " +
                     std::to_string(kStoreVersion)) != std::string::npos);
  }
}

TEST_CASE("Damaged blocks that pass no checksum never lead out of their bytes") {
  const Bytes hot = LayOutHot(MakeHot()), shading = LayOutShading(MakeShading());
  Bytes whole = hot;
  REQUIRE(ViewHot(whole, 1e-6f).has_value());
  REQUIRE(ViewShading(shading).has_value());
  std::mt19937 random(3);
  for (int i = 0; i < 20000; ++i) {
    Bytes bad = i % 2 ? hot : shading;
    for (int k = 0; k < 1 + i % 3; ++k) bad[random() % bad.size()] = static_cast<std::byte>(random());
    if (i % 5 == 0) bad.resize(random() % (bad.size() + 1));
    const auto view = ViewHot(bad, 1e-6f);
    if (view)
      for (uint32_t r = 0; r < view->reference_count; ++r)
        REQUIRE(view->references[r] < view->triangle_count);
    (void)ViewShading(bad);
    Bytes out(300);
    (void)DecompressBlock(bad, out);
  }
}

TEST_CASE("A hot block's counts must be those of its tree") {
  HotVoxel more = MakeHot();
  more.wide_nodes = 2;
  Bytes block = LayOutHot(more);
  CHECK(ViewHot(block, 1e-6f).error().message == "voxel block: not as many wide nodes as its tree has");
  HotVoxel twice = MakeHot();
  twice.nodes = LayOutTreelets(std::vector{KdNode::Inner(0, 0.5f, 1), KdNode::Leaf(1, 2), KdNode::Leaf(1, 2)},
                               kTreeletLevels);
  block = LayOutHot(twice);
  CHECK(ViewHot(block, 1e-6f).error().message == "voxel block: leaves have references in common");
}

TEST_CASE("Nothing is at the final name before a store is finished") {
  const Folder folder;
  {
    auto writer = StoreWriter::Create(folder.file("s"));
    REQUIRE(writer->AddVoxel(EncodeVoxel(LayOutHot(MakeHot()), {}, 2)).has_value());
    CHECK_FALSE(std::filesystem::exists(folder.file("s")));
  }
  CHECK(std::filesystem::is_empty(folder.path));
}

}  // namespace quarry
