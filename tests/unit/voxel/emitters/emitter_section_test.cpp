#include "common/voxel/emitters/emitter_section.h"

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <string>

#include "common/voxel/store_reader.h"
#include "common/voxel/store_writer.h"
#include "tests/fuzz/store_mend.h"
#include "tests/support/stores/changed_store.h"
#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::Changed;

/// Writes a store of two triangles, which shine, with the materials paint, lamp and screen, which has a map.
void WriteShining(const std::string& path, const std::vector<Emitter>& emitters) {
  auto writer = StoreWriter::Create(path);
  REQUIRE(writer);
  REQUIRE(writer->AddVoxel(EncodeVoxel(test::TwoTriangles(), nullptr)));
  SceneMeta meta;
  meta.bounds_upper = meta.root_upper = glm::vec3(1);
  meta.input_triangles = 9;
  const TexelLayout layout{1, 1, 1, TexelFormat::kLinear8};
  writer->BeginTexture("map", layout);
  const std::array<std::byte, 1> texel{std::byte{99}};
  REQUIRE(writer->AddPage(0, EncodeTexturePage(TextureShape(1, 1), layout, 0, texel)));
  Material lamp{"lamp"}, screen{"screen"};
  lamp.emission = {3, 2, 1};
  screen.textures = {{TextureUse::kEmission, 0}};
  writer->SetEmitters(emitters);
  REQUIRE(writer->Finish(meta, {KdNode::Leaf(0, 1)}, {Material{"paint"}, lamp, screen},
                         test::RootParts({"a", "b"})));
}

Emitter Shining(uint32_t triangle) {
  return {triangle, 1, 1, {{0, 0, 0.5f}, {1, 0, 0.5f}, {0, 0.25f, 1}}, {}, {3, 2, 1}};
}
Emitter Mapped(uint32_t triangle) {
  Emitter emitter = Shining(triangle);
  emitter.material = 2;
  for (int i = 0; i < 3; ++i) emitter.uvs[i] = {i, -0.5f * static_cast<float>(i)};
  emitter.radiance = {0.1f, 0, 0.2f};
  return emitter;
}

}  // namespace

TEST_CASE("A store returns its emitters with the catalog", "[path]") {
  const test::TemporaryFolder folder;
  const std::vector<Emitter> emitters{Shining(2), Mapped(3), Shining(4), Mapped(8)};
  WriteShining(folder.file("s"), emitters);
  CHECK(test::FaultOf(folder.file("s")).empty());
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  CHECK(store->catalog().emitters == emitters);
  // As a worker gets it.
  const Bytes packed = PackSections(store->catalog_sections());
  const auto sent = UnpackSections(packed);
  REQUIRE(sent);
  CHECK(DecodeCatalog(store->catalog().id, *sent)->emitters == emitters);
  CHECK((sent && store->catalog().names_emitters && Shines(store->catalog())));
  WriteShining(folder.file("none"), {});
  const auto none = StoreReader::Open(folder.file("none"));
  REQUIRE(none);
  CHECK(none->catalog().emitters.empty());
  CHECK_FALSE(Shines(none->catalog()));
  WriteShining(folder.file("screens"), {Mapped(1)});
  const auto screens = StoreReader::Open(folder.file("screens"));
  REQUIRE(screens);
  CHECK(screens->catalog().emitters.size() == 1);
  CHECK_FALSE(Shines(screens->catalog()));
}

TEST_CASE("A store of a version before maps of emission has the other emitters", "[path]") {
  const test::TemporaryFolder folder;
  WriteShining(folder.file("s"), {Shining(2), Mapped(3)});
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  std::vector<Section> sections = store->catalog_sections();
  std::erase_if(sections,
                [](const Section& section) { return section.type == SectionType::kMappedEmitters; });
  const auto old = DecodeCatalog(store->catalog().id, sections);
  REQUIRE(old);
  CHECK(old->emitters == std::vector{Shining(2)});
}

TEST_CASE("A store of a version before emitters shines by its materials", "[path]") {
  const test::TemporaryFolder folder;
  WriteShining(folder.file("s"), {});
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  std::vector<Section> sections = store->catalog_sections();
  std::erase_if(sections, [](const Section& section) { return section.type == SectionType::kEmitters; });
  const auto old = DecodeCatalog(store->catalog().id, sections);
  REQUIRE(old);
  CHECK_FALSE(old->names_emitters);
  CHECK(Shines(*old));
}

TEST_CASE("A store of a version before materials' forms compares the two", "[path]") {
  const test::TemporaryFolder folder;
  WriteShining(folder.file("s"), {});
  const auto with_flags = [&](uint32_t flags) -> Result<Catalog> {
    Changed store(folder.file("s"));
    constexpr uint64_t kEntry = 4, kFlags = 72;
    store.Put(store.Begin(SectionType::kMaterials) + kEntry + kFlags, flags);
    fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
    auto opened = store.Open();
    if (!opened) return tl::unexpected<Error>(opened.error());
    return opened->catalog();
  };
  CHECK(with_flags(0)->materials[0].is_open_pbr);
  CHECK(with_flags(4)->materials[0].is_open_pbr);
  CHECK_FALSE(with_flags(8)->materials[0].is_open_pbr);
  CHECK_FALSE(with_flags(12).has_value());
  CHECK_FALSE(with_flags(16).has_value());
}

TEST_CASE("Damaged emitters are refused", "[path]") {
  const test::TemporaryFolder folder;
  WriteShining(folder.file("s"), {Shining(2), Shining(3), Shining(8)});
  const auto fault = [&](uint64_t at, auto value) {
    Changed store(folder.file("s"));
    store.Put(store.Begin(SectionType::kEmitters) + at, value);
    fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
    const auto opened = store.Open();
    return opened ? std::string() : opened.error().message;
  };
  CHECK(fault(0, 1u).empty());
  for (const uint32_t triangle : {3u, 9u, ~0u})
    CHECK_THAT(fault(0, triangle), Catch::Contains("out of order"));
  for (const uint32_t material : {0u, 3u, ~0u})
    CHECK_THAT(fault(8, material), Catch::Contains("material that does not shine"));
  CHECK_THAT(fault(8, 2u), Catch::Contains("material with a map"));
  for (const float corner : {-0.1f, 1.5f, std::nanf(""), HUGE_VALF})
    CHECK_THAT(fault(12, corner), Catch::Contains("outside of the scene"));
  CHECK_THAT(fault(24, 0.0f), Catch::Contains("without area"));
}

TEST_CASE("Damaged emitters with a map are refused", "[path]") {
  const test::TemporaryFolder folder;
  WriteShining(folder.file("s"), {Shining(2), Mapped(3), Mapped(8)});
  const auto fault = [&](uint64_t at, auto value) {
    Changed store(folder.file("s"));
    store.Put(store.Begin(SectionType::kMappedEmitters) + at, value);
    fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
    const auto opened = store.Open();
    return opened ? std::string() : opened.error().message;
  };
  CHECK(fault(0, 4u).empty());
  CHECK_THAT(fault(0, 2u), Catch::Contains("a triangle twice"));
  CHECK_THAT(fault(0, 8u), Catch::Contains("out of order"));
  CHECK_THAT(fault(8, 1u), Catch::Contains("material without a map"));
  CHECK_THAT(fault(12, 1.5f), Catch::Contains("outside of the scene"));
  for (const float place : {std::nanf(""), HUGE_VALF})
    CHECK_THAT(fault(48, place), Catch::Contains("place that is not finite"));
  CHECK(fault(72, 0.0f).empty());
  for (const float radiance : {-1.0f, std::nanf(""), HUGE_VALF})
    CHECK_THAT(fault(72, radiance), Catch::Contains("radiance that is none"));
}

TEST_CASE("A material shines wholly, or its triangles are in no table", "[path]") {
  Material m;
  CHECK_FALSE(Shines(m));
  m.emission = {0, 0.1f, 0};
  CHECK(Shines(m));
  m.textures = {{TextureUse::kDiffuse}};
  CHECK(Shines(m));
  m.textures = {{TextureUse::kOpacity}};
  CHECK_FALSE(Shines(m));
  m.textures = {{TextureUse::kEmission}};
  CHECK((Shines(m) && EmissionOf(m) == glm::vec3(1)));
  m.textures[0].factor = glm::vec4(0, 0, 0, 1);
  CHECK_FALSE(Shines(m));
  m.textures = {};
  m.geometry_opacity = 0.5f;
  CHECK_FALSE(Shines(m));
  m.geometry_opacity = 1;
  m.transmission_weight = 0.5f;
  CHECK_FALSE(Shines(m));
  m.transmission_weight = 0;
  m.unlit = true;
  CHECK_FALSE(Shines(m));
}

}  // namespace quarry
