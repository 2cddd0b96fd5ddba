
#include <algorithm>
#include <array>
#include <bit>
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <limits>
#include <random>

#include "common/kdtree/build/treelets.h"
#include "common/kdtree/opacity_mask.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/store_header.h"
#include "common/voxel/store_reader.h"
#include "common/voxel/store_writer.h"
#include "tests/support/rendering/flat_tree.h"
#include "tests/support/stores/every_material.h"
#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::FaultOf;
using test::ReadFile;
using test::TemporaryFolder;
using test::WriteFile;

HotVoxel MakeHot() {
  HotVoxel v = test::TwoTriangles();
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
  m.dropped_transparent = 1;
  m.voxel_size = 4096;
  return m;
}

std::vector<Material> MakeMaterials() {
  Material brick{"brick"};
  brick.is_open_pbr = false;
  return {Material{"paint"}, test::EveryMaterial("steel"), brick};
}

SceneViews MakeViews() {
  SceneViews views;
  views.cameras = {{"front", {{1, 2, 3}, {4, 5, 6}, {0, 1, 0}, 30, 7}}};
  views.lights = {{"lamp", LightKind::kPoint, {1, 2, 3}, {0, 0, -1}, {4, 5, 6}, 0.75f, 0.5f},
                  {"sun", LightKind::kSun},
                  {"panel", LightKind::kRectangle, {1, 2, 3}},
                  {"door", LightKind::kPoint}};
  views.lights[2].edges[0] = {1, 0, 0.5f};
  views.lights[2].edges[1] = {0, 2, 0};
  return views;
}

SceneId WriteStore(const std::string& path) {
  auto writer = StoreWriter::Create(path);
  REQUIRE(writer.has_value());
  const ShadingVoxel shading = MakeShading();
  EncodedVoxel first = EncodeVoxel(MakeHot(), &shading);
  first.chained = true;
  REQUIRE(writer->AddVoxel(first).has_value());
  REQUIRE(writer->AddVoxel(EncodeVoxel(MakeHot(), nullptr)).has_value());
  const auto id = writer->Finish(MakeMeta(), {KdNode::Leaf(0, 1)}, MakeMaterials(),
                                 test::RootParts({"valve", "pump"}), MakeViews(), {"plant.obj", "pipes.ply"});
  REQUIRE(id.has_value());
  return *id;
}

}  // namespace

TEST_CASE("A store returns everything written to it") {
  const TemporaryFolder folder;
  const SceneId id = WriteStore(folder.file("s"));
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store.has_value());
  CHECK(FaultOf(folder.file("s")).empty());
  const Catalog& c = store->catalog();
  CHECK(c.id == id);
  SceneMeta expected = MakeMeta();
  expected.stored_references = 4;
  expected.largest_decoded = c.meta.largest_decoded;
  expected.largest_stored = c.meta.largest_stored;
  expected.lz4_version = c.meta.lz4_version;
  CHECK(c.meta == expected);
  CHECK(test::FlattenTreelets(c.top_nodes) == std::vector<KdNode>{KdNode::Leaf(0, 1)});
  CHECK(c.top_node_count == 1);
  REQUIRE(c.voxels.size() == 2);
  CHECK(c.voxels[0].next_in_chain == 1);
  CHECK(c.voxels[1].next_in_chain == kNoIndex);
  CHECK(c.voxels[1].blocks[1].stored == 0);
  CHECK(store->models().count == 2);
  CHECK(store->models().names == std::vector<std::string>{"plant.obj", "pipes.ply"});
  CHECK(store->part_count() == 2);
  CHECK(store->PartName(0) == "valve");
  CHECK(store->PartName(1) == "pump");
  CHECK(store->PartName(2) == "");
  CHECK(store->MaterialName(0) == "paint");
  CHECK(store->MaterialName(1) == "steel");
  auto materials = MakeMaterials();
  for (Material& m : materials) m.name.clear();
  CHECK(c.materials == materials);
  REQUIRE(store->views().cameras.size() == 1);
  const auto& [name, front] = store->views().cameras[0];
  const CameraSpec given = MakeViews().cameras[0].spec;
  CHECK(name == "front");
  CHECK((front.eye == given.eye && front.at == given.at && front.up == given.up));
  CHECK((front.fov_degrees == 30 && front.ortho_height == 7));
  CHECK(store->views().lights == MakeViews().lights);

  const auto stored = store->ReadBlock(BlockKey::Hot(0));
  REQUIRE(stored.has_value());
  BlockDecoder decoder;
  Bytes hot_bytes(c.block(BlockKey::Hot(0)).decoded), shading_bytes(c.block(BlockKey::Shading(0)).decoded);
  std::vector<KdNode> tree;
  const auto hot = decoder.Hot(*stored, hot_bytes, c.meta.padding, &tree);
  REQUIRE(hot.has_value());
  const HotVoxel in = MakeHot();
  CHECK(test::FlattenTreelets(tree) == in.nodes);
  const auto same = [](const auto& put_in, const auto* got) {
    return std::equal(put_in.begin(), put_in.end(), got);
  };
  CHECK((hot->triangle_count == 2 && hot->vertex_count == 4 && hot->reference_count == 3));
  CHECK(same(in.references, hot->references));
  CHECK(same(in.corners, hot->corners));
  CHECK(same(in.vertices, hot->vertices));
  CHECK(same(in.triangle_ids, hot->triangle_ids));
  CHECK(same(in.materials, hot->materials));
  CHECK(same(in.parts, hot->parts));
  const auto shaded = decoder.Shading(*store->ReadBlock(BlockKey::Shading(0)), shading_bytes);
  REQUIRE(shaded.has_value());
  CHECK(same(MakeShading().corners, shaded->corners));
  CHECK(same(MakeShading().vertices, shaded->vertices));
  for (const BlockKey none : {BlockKey::Hot(2), BlockKey::Shading(1), BlockKey::Page(0)}) {
    const auto block = store->ReadBlock(none);
    REQUIRE_FALSE(block.has_value());
    CHECK(block.error().permanent());
  }
}

TEST_CASE("The error of a damaged block states that another try is useless") {
  const TemporaryFolder folder;
  WriteStore(folder.file("s"));
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store.has_value());
  auto bytes = ReadFile(folder.file("s"));
  const BlockEntry& entry = store->catalog().block(BlockKey::Hot(0));
  bytes[entry.offset + entry.stored / 2] ^= 1;
  WriteFile(folder.file("bad"), bytes);
  const auto bad = StoreReader::Open(folder.file("bad"));
  REQUIRE(bad.has_value());
  const auto block = bad->ReadBlock(BlockKey::Hot(0));
  REQUIRE_FALSE(block.has_value());
  CHECK_THAT(block.error().message, Catch::Contains("damaged (checksum)"));
  CHECK(block.error().permanent());
  CHECK(bad->ReadBlock(BlockKey::Shading(0)).has_value());
}

TEST_CASE("A store whose directory states wrong positions of voxels is refused") {
  const TemporaryFolder folder;
  // The fault found in a store of two voxels, of which the first was changed before it was written.
  const auto fault = [&](auto change, std::vector<KdNode> top) {
    auto writer = StoreWriter::Create(folder.file("s"));
    REQUIRE(writer.has_value());
    EncodedVoxel voxel = EncodeVoxel(MakeHot(), nullptr);
    change(voxel);
    REQUIRE(writer->AddVoxel(voxel).has_value());
    REQUIRE(writer->AddVoxel(EncodeVoxel(MakeHot(), nullptr)).has_value());
    REQUIRE(writer->Finish(MakeMeta(), top, MakeMaterials(), test::RootParts({"valve", "pump"})).has_value());
    return FaultOf(folder.file("s"));
  };
  const std::vector<KdNode> leaf{KdNode::Leaf(0, 1)};
  const float nan = std::numeric_limits<float>::quiet_NaN();
  CHECK(fault([](EncodedVoxel&) {}, leaf).empty());
  CHECK_THAT(fault([](EncodedVoxel& v) { v.bounds_upper.y = 0.5f; }, leaf),
             Catch::Contains("lie elsewhere than the VDIR section states"));
  CHECK_THAT(fault([](EncodedVoxel& v) { v.bounds_lower.x = 2; }, leaf),
             Catch::Contains("lies at an invalid place"));
  CHECK_THAT(fault([](EncodedVoxel& v) { v.bounds_upper.z = 2; }, leaf),
             Catch::Contains("lies at an invalid place"));
  CHECK_THAT(fault([&](EncodedVoxel& v) { v.bounds_lower.z = nan; }, leaf),
             Catch::Contains("lies at an invalid place"));
  // A decoded size too small for the block's stored size, and the least possible size, which is not the true
  // one.
  const auto decodes_to = [](uint32_t less) {
    return [=](EncodedVoxel& v) { v.hot_decoded = (static_cast<uint32_t>(v.hot.size()) - 15) / 2 - less; };
  };
  CHECK_THAT(fault(decodes_to(1), leaf), Catch::Contains("has an invalid size or place"));
  CHECK_THAT(fault(decodes_to(0), leaf), Catch::Contains("more bytes than the directory's entry allows") ||
                                             Catch::Contains("counts do not fit its size"));
  // In two leaves; and within another's chain.
  const std::vector<KdNode> twice{KdNode::Inner(0, 0.5f, 1), KdNode::Leaf(0, 1), KdNode::Leaf(0, 1)},
      within{KdNode::Inner(0, 0.5f, 1), KdNode::Leaf(0, 1), KdNode::Leaf(1, 1)};
  CHECK(fault([](EncodedVoxel&) {}, within).empty());
  CHECK_THAT(fault([](EncodedVoxel&) {}, twice), Catch::Contains("leads nowhere"));
  CHECK_THAT(fault([](EncodedVoxel& v) { v.chained = true; }, within), Catch::Contains("leads nowhere"));
  // As many levels as may be, and one more.
  std::vector<KdNode> deep = within;
  while (deep.size() < 2 * kMostLevels + 1) {
    const auto last = static_cast<uint32_t>(deep.size() - 1);
    deep.push_back(KdNode::Leaf(0, 0));
    deep.push_back(std::exchange(deep[last], KdNode::Inner(0, 0.5f, last + 1)));
  }
  CHECK(fault([](EncodedVoxel&) {}, deep).empty());
  const auto last = static_cast<uint32_t>(deep.size() - 1);
  deep.push_back(KdNode::Leaf(0, 0));
  deep.push_back(std::exchange(deep[last], KdNode::Inner(0, 0.5f, last + 1)));
  CHECK_THAT(fault([](EncodedVoxel&) {}, deep), Catch::Contains("has more than 128 levels"));
}

TEST_CASE("An empty hot block is refused") {
  HotVoxel nothing;
  nothing.cell = {glm::vec3(0), glm::vec3(1)};
  nothing.nodes = {KdNode::Leaf(0, 0)};
  nothing.node_slots = 4;
  nothing.wide_nodes = 1;
  const Bytes stored = CompressBlock(EncodeHot(nothing));
  Bytes decoded(HotBytes(nothing.wide_nodes, 0, 0, 0));
  BlockDecoder decoder;
  CHECK_FALSE(decoder.Hot(stored, decoded, 0).has_value());
}

TEST_CASE("Every byte of a store that is flipped is found") {
  const TemporaryFolder folder;
  WriteStore(folder.file("s"));
  const auto good = ReadFile(folder.file("s"));
  for (size_t at = 0; at < good.size(); ++at) {
    auto bad = good;
    bad[at] = static_cast<char>(bad[at] ^ (1 << at % 8));
    WriteFile(folder.file("bad"), bad);
    INFO("byte " << at);
    const std::string fault = FaultOf(folder.file("bad"));
    CHECK(fault.find("bad: ") != std::string::npos);
  }
}

TEST_CASE("Truncated stores are refused at every length") {
  const TemporaryFolder folder;
  WriteStore(folder.file("s"));
  auto bytes = ReadFile(folder.file("s"));
  while (!bytes.empty()) {
    bytes.pop_back();
    WriteFile(folder.file("bad"), bytes);
    REQUIRE_FALSE(FaultOf(folder.file("bad")).empty());
  }
}

TEST_CASE("An error of the format version names both versions") {
  const TemporaryFolder folder;
  WriteStore(folder.file("s"));
  for (uint32_t version : {0u, kStoreVersion + 1}) {
    auto bytes = ReadFile(folder.file("s"));
    std::memcpy(bytes.data() + 8, &version, 4);
    const uint64_t checksum = Checksum(std::as_bytes(std::span(bytes).first(56)));
    std::memcpy(bytes.data() + 56, &checksum, 8);
    WriteFile(folder.file("other"), bytes);
    const std::string fault = FaultOf(folder.file("other"));
    CHECK(fault.find("version " + std::to_string(version) + ", this program reads version " +
                     std::to_string(kStoreVersion)) != std::string::npos);
  }
}

namespace {

/// A block whose streams need no LZ4 to be put in.
Bytes Stored(const Bytes& streams) {
  ByteWriter out;
  out.Put(static_cast<uint32_t>(streams.size()));
  out.PutArray(streams);
  return out.Take();
}

size_t DecodedBytes(const HotVoxel& v) {
  return HotBytes(v.wide_nodes, v.references.size(), v.triangle_ids.size(), v.vertices.size(), v.masks.size(),
                  v.fine_masks.size());
}

/// The sentence that a block is refused with.
std::string Refusal(const HotVoxel& voxel) {
  Bytes out(DecodedBytes(voxel));
  const auto view = BlockDecoder().Hot(Stored(EncodeHot(voxel)), out, 1e-6f);
  return view ? "" : view.error().message;
}

}  // namespace

TEST_CASE("Damaged blocks, read without a checksum, are never read beyond their bytes") {
  const ShadingVoxel plain = MakeShading();
  const Bytes hot = Stored(EncodeHot(MakeHot())), shading = Stored(EncodeShading(plain));
  const EncodedVoxel packed = EncodeVoxel(MakeHot(), &plain);
  BlockDecoder decoder;
  Bytes hot_out(packed.hot_decoded), shading_out(packed.shading_decoded);
  REQUIRE(decoder.Hot(hot, hot_out, 1e-6f).has_value());
  REQUIRE(decoder.Shading(shading, shading_out).has_value());
  std::mt19937 random(3);
  int survived = 0;
  for (int i = 0; i < 40000; ++i) {
    Bytes bad = i % 4 == 0 ? packed.hot : i % 4 == 1 ? shading : hot;
    for (int k = 0; k < 1 + i % 3; ++k) bad[random() % bad.size()] = static_cast<std::byte>(random());
    if (i % 5 == 0) bad.resize(random() % (bad.size() + 1));
    std::vector<KdNode> tree;
    const auto view = decoder.Hot(bad, hot_out, 1e-6f, &tree);
    if (view) {
      ++survived;
      REQUIRE(test::FlattenTreelets(tree).size() <= tree.size());
      for (uint32_t r = 0; r < view->reference_count; ++r)
        REQUIRE(view->references[r] < view->triangle_count);
      for (uint32_t c = 0; c < 3 * view->triangle_count; ++c) REQUIRE(view->corners[c] < view->vertex_count);
    }
    (void)decoder.Shading(bad, shading_out);
  }
  CHECK(survived > 1000);
}

TEST_CASE("A hot block's counts must be those of its tree") {
  CHECK(Refusal(MakeHot()).empty());
  HotVoxel bad = MakeHot();
  bad.wide_nodes = 2;
  CHECK(Refusal(bad) == "voxel block: not as many wide nodes as its tree has");
  bad = MakeHot();
  bad.node_slots = 10;
  CHECK(Refusal(bad) == "voxel block: not as many node slots as its tree takes");
  bad = MakeHot();
  bad.node_slots = static_cast<uint32_t>(DecodedBytes(bad) / sizeof(KdNode)) + 1;
  CHECK(Refusal(bad) == "voxel block: counts do not fit its size");
  bad = MakeHot();
  bad.vertices[0].x = std::numeric_limits<float>::quiet_NaN();  // never hit, and no harm
  CHECK(Refusal(bad).empty());
  bad.cell.upper.x = std::numeric_limits<float>::infinity();
  CHECK(Refusal(bad) == "voxel block: its cell is not finite");
  bad = MakeHot();
  bad.nodes[0] = KdNode::Inner(0, std::numeric_limits<float>::infinity(), 1);
  CHECK(Refusal(bad) == "voxel block: a plane is not finite");
  // Too little room, or too much.
  Bytes out(DecodedBytes(MakeHot()));
  for (int change : {-1, 1}) {
    out.resize(static_cast<size_t>(static_cast<int>(out.size()) + change));
    CHECK(BlockDecoder().Hot(Stored(EncodeHot(MakeHot())), out, 1e-6f).error().message ==
          "voxel block: counts do not fit its size");
    out.resize(DecodedBytes(MakeHot()));
  }
}

TEST_CASE("Symbols that form no tree are refused") {
  const Bytes good = EncodeHot(MakeHot());
  // The header's 52 bytes; then the symbols' low bytes: inner by x, leaf of 1, leaf of 2.
  constexpr size_t kSymbols = 52;
  REQUIRE(static_cast<int>(good[kSymbols]) == 0);
  REQUIRE(static_cast<int>(good[kSymbols + 1]) == 4);
  REQUIRE(static_cast<int>(good[kSymbols + 2]) == 5);
  const auto refusal = [&](std::array<int, 3> symbols) {
    Bytes streams = good, out(DecodedBytes(MakeHot()));
    for (size_t i = 0; i < 3; ++i) streams[kSymbols + i] = static_cast<std::byte>(symbols[i]);
    const auto view = BlockDecoder().Hot(Stored(streams), out, 1e-6f);
    return view ? "" : view.error().message;
  };
  CHECK(refusal({0, 4, 5}).empty());
  CHECK(refusal({0, 5, 4}).empty());
  CHECK(refusal({4, 0, 5}) == "voxel block: nodes beyond the tree");
  for (const std::array<int, 3> other : {std::array{0, 0, 5}, {0, 4, 0}, {4, 4, 5}})
    CHECK(refusal(other) == "voxel block: not as many inner nodes as planes");
  CHECK(refusal({0, 4, 6}) == "voxel block: leaves do not have all references");
  CHECK(refusal({0, 3, 3}) == "voxel block: leaves do not have all references");
}

TEST_CASE("Decoding marks see-through triangles by their material, and parts stay as they are") {
  HotVoxel v = MakeHot();
  v.parts = {5, (1u << 31) - 1};
  Bytes out(DecodedBytes(v));
  auto hot = BlockDecoder().Hot(Stored(EncodeHot(v)), out, 1e-6f);
  REQUIRE(hot.has_value());
  CHECK_FALSE(hot->has_see_through);
  Material wall, glass;
  glass.transmittance = {0, 0.5f, 0};
  MarkSeeThrough({wall, wall}, *hot);
  CHECK_FALSE((hot->has_see_through || hot->see_through(0) || hot->see_through(1)));
  MarkSeeThrough({wall, glass}, *hot);
  CHECK((hot->has_see_through && !hot->see_through(0) && hot->see_through(1)));
  CHECK((hot->part(0) == 5 && hot->part(1) == (1u << 31) - 1));
  v.parts[0] = 1u << 31;
  CHECK(BlockDecoder().Hot(Stored(EncodeHot(v)), out, 1e-6f).error().message ==
        "voxel block: it names a part beyond the limit");
}

TEST_CASE("Blocks of random numbers are restored unchanged") {
  std::mt19937 random(12);
  for (uint32_t triangles : {1u, 2u, 63u, 3000u}) {
    HotVoxel v = MakeHot();
    v.references.clear();
    v.corners.clear();
    v.vertices.clear();
    v.triangle_ids.clear();
    v.materials.clear();
    v.parts.clear();
    v.masks.clear();
    v.fine_masks.clear();
    for (uint32_t i = 0; i < triangles; ++i) {
      v.triangle_ids.push_back(random());
      v.parts.push_back(random() >> 1);
      // States of no more than 2, and in every other voxel none.
      if (triangles % 2 == 1) v.masks.push_back(random() & kOpaqueMask << (random() % 2));
      // Some triangles of the larger ones name fine masks.
      if (triangles >= 63 && triangles % 2 == 1 && i % 5 == 0) {
        v.masks.back() = NameFineMask(static_cast<uint32_t>(v.fine_masks.size()));
        for (uint32_t& word : v.fine_masks.emplace_back().words)
          word = random() & kOpaqueMask << (random() % 2);
      }
      v.materials.push_back(static_cast<uint16_t>(random()));
      v.references.push_back(static_cast<uint16_t>(i));
      for (int k = 0; k < 3; ++k) {
        const bool fresh = v.vertices.empty() || random() % 2 != 0;
        v.corners.push_back(static_cast<uint16_t>(fresh ? v.vertices.size() : random() % v.vertices.size()));
        if (fresh)
          v.vertices.emplace_back(std::bit_cast<float>(static_cast<uint32_t>(random())), -0.0f,
                                  static_cast<float>(random()));
      }
    }
    v.nodes = {KdNode::Inner(2, -7.25f, 1), KdNode::Leaf(0, 0), KdNode::Leaf(0, triangles)};
    const EncodedVoxel encoded = EncodeVoxel(v, nullptr);
    Bytes out(encoded.hot_decoded);
    std::vector<KdNode> tree;
    const auto hot = BlockDecoder().Hot(encoded.hot, out, 1e-6f, &tree);
    INFO((hot ? "" : hot.error().message));
    REQUIRE(hot.has_value());
    CHECK(test::FlattenTreelets(tree) == v.nodes);
    CHECK(std::equal(v.references.begin(), v.references.end(), hot->references));
    CHECK(std::equal(v.corners.begin(), v.corners.end(), hot->corners));
    CHECK(std::memcmp(v.vertices.data(), hot->vertices, v.vertices.size() * 12) == 0);
    CHECK(std::equal(v.triangle_ids.begin(), v.triangle_ids.end(), hot->triangle_ids));
    CHECK(std::equal(v.materials.begin(), v.materials.end(), hot->materials));
    CHECK(std::equal(v.parts.begin(), v.parts.end(), hot->parts));
    CHECK(encoded.masks == !v.masks.empty());
    REQUIRE((hot->masks != nullptr) == encoded.masks);
    CHECK(std::equal(v.masks.begin(), v.masks.end(), hot->masks));
    REQUIRE(hot->fine_mask_count == v.fine_masks.size());
    CHECK(std::equal(v.fine_masks.begin(), v.fine_masks.end(), hot->fine_masks));
  }
}

TEST_CASE("A hot block whose opacity masks hold a fourth state is refused") {
  HotVoxel v = MakeHot();
  v.masks = {kOpaqueMask, kTransparentMask};
  CHECK(Refusal(v).empty());
  for (int bit = 0; bit < 32; bit += 2) {
    v.masks[1] = kTransparentMask | 1u << bit;
    CHECK_THAT(Refusal(v), Catch::Contains("an opacity mask holds an invalid state"));
  }
}

TEST_CASE("A hot block is refused that names a fine mask it lacks, or has one of a fourth state") {
  HotVoxel v = MakeHot();
  v.masks = {NameFineMask(0), kTransparentMask};
  CHECK_THAT(Refusal(v), Catch::Contains("names a fine mask that it lacks"));
  v.fine_masks.push_back({});
  CHECK(Refusal(v).empty());
  v.masks[1] = NameFineMask(1);
  CHECK_THAT(Refusal(v), Catch::Contains("names a fine mask that it lacks"));
  v.masks[1] = NameFineMask(0) & ~(1u << 28);  // as decoding marks glass, no store does
  CHECK_THAT(Refusal(v), Catch::Contains("an opacity mask holds an invalid state"));
  v.masks[1] = NameFineMask(0);
  for (uint32_t& word : v.fine_masks[0].words) {
    word = kOpaqueMask;
    CHECK(Refusal(v).empty());
    word |= 2u << 12;
    CHECK_THAT(Refusal(v), Catch::Contains("a fine opacity mask holds an invalid state"));
    word = kTransparentMask;
  }
}

TEST_CASE("A store states whether voxels have opacity masks, in its version too") {
  const TemporaryFolder folder;
  const auto version_of = [&](std::vector<std::vector<uint32_t>> masks, bool packed) {
    auto writer = StoreWriter::Create(folder.file("s"));
    if (packed) writer->AllowPackedNormals();
    for (const std::vector<uint32_t>& of_voxel : masks) {
      HotVoxel v = MakeHot();
      v.masks = of_voxel;
      EncodedVoxel encoded = EncodeVoxel(v, nullptr);
      encoded.chained = &of_voxel != &masks.back();
      REQUIRE(writer->AddVoxel(encoded));
    }
    REQUIRE(writer->Finish(MakeMeta(), {KdNode::Leaf(0, 1)}, MakeMaterials(),
                           test::RootParts({"valve", "pump"})));
    const auto store = StoreReader::Open(folder.file("s"));
    REQUIRE(store);
    CHECK(FaultOf(folder.file("s")).empty());
    CHECK(store->catalog().meta.dropped_transparent == 1);
    CHECK(store->catalog().meta.kept_triangles() == 1);
    const auto version = static_cast<uint8_t>(ReadFile(folder.file("s"))[8]);
    CHECK(store->catalog().meta.masks == (version == kStoreVersion));
    return version;
  };
  CHECK(version_of({{}}, false) == kUnpackedStoreVersion);
  CHECK(version_of({{}}, true) == kPackedStoreVersion);
  CHECK(version_of({{}, {kOpaqueMask, 0}}, true) == kStoreVersion);
  CHECK(version_of({{kOpaqueMask, 0}, {}}, false) == kStoreVersion);
}

TEST_CASE("No file has the final name before a store is finished") {
  const TemporaryFolder folder;
  {
    auto writer = StoreWriter::Create(folder.file("s"));
    REQUIRE(writer->AddVoxel(EncodeVoxel(MakeHot(), nullptr)).has_value());
    CHECK_FALSE(std::filesystem::exists(folder.file("s")));
  }
  CHECK(std::filesystem::is_empty(folder.path()));
}

}  // namespace quarry
