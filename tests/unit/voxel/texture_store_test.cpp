#include <catch2/catch.hpp>
#include <cstring>
#include <fstream>
#include <random>

#include "common/voxel/store_reader.h"
#include "common/voxel/store_writer.h"
#include "common/voxel/texture_page.h"
#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::FaultOf;
using test::ReadFile;
using test::TemporaryFolder;
using test::WriteFile;

EncodedVoxel OneVoxel() {
  HotVoxel voxel = test::TwoTriangles();
  voxel.materials = {0, 1};
  return EncodeVoxel(voxel, nullptr);
}

Bytes TexelsOf(const TextureShape& shape, const TexelLayout& layout, uint32_t page, uint32_t seed) {
  std::mt19937 random(seed + page);
  Bytes texels(shape.TexelsOf(page) * layout.texel_bytes());
  for (std::byte& b : texels) b = static_cast<std::byte>(random() % 16);
  return texels;
}

const TexelLayout kWood{200, 100, 3, TexelFormat::kSrgb8}, kSky{70, 5, 4, TexelFormat::kHalf};

void AddTexture(StoreWriter& writer, const std::string& name, const TexelLayout& layout, uint32_t seed) {
  const TextureShape shape(layout.width, layout.height);
  writer.BeginTexture(name, layout);
  for (uint32_t p = shape.pages(); p-- > 0;)  // in another order than they are numbered
    REQUIRE(writer.AddPage(p, EncodeTexturePage(shape, layout, p, TexelsOf(shape, layout, p, seed))));
}

std::vector<Material> Painted() {
  Material wood{"wood"}, sky{"sky"};
  TextureBinding binding;
  binding.texture = 0;
  binding.wrap_s = TextureWrap::kClamp;
  binding.wrap_t = TextureWrap::kMirror;
  binding.transform = {2, 0.5f, 0.25f, -1, 3, 4};
  binding.factor = {0.1f, 0.2f, 0.3f, 0.4f};
  wood.textures = {binding};
  binding.use = TextureUse::kEmission;
  binding.texture = 1;
  TextureBinding mask;
  mask.use = TextureUse::kOpacity;
  mask.texture = 0;
  mask.cutoff = 0.5f;
  sky.textures = {binding, mask};
  return {wood, sky};
}

SceneId WriteStore(const std::string& path, uint32_t seed = 1,
                   const std::vector<Material>& materials = Painted()) {
  auto writer = StoreWriter::Create(path);
  REQUIRE(writer);
  REQUIRE(writer->AddVoxel(OneVoxel()));
  AddTexture(*writer, "wood.png", kWood, seed);
  AddTexture(*writer, "gone.png", kWood, 99);
  REQUIRE(writer->DropTexture());
  AddTexture(*writer, "sky.exr", kSky, seed);
  SceneMeta meta;
  meta.root_upper = glm::vec3(1);
  meta.padding = 1e-6f;
  const auto id = writer->Finish(meta, {KdNode::Leaf(0, 1)}, materials, test::RootParts({"part"}));
  REQUIRE(id);
  return *id;
}

}  // namespace

TEST_CASE("A store returns its textures, page by page", "[texture][store]") {
  const TemporaryFolder folder;
  WriteStore(folder.file("s"));
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  REQUIRE(store->textures().size() == 2);
  CHECK(store->TextureName(0) == "wood.png");
  CHECK(store->textures()[0].layout == kWood);
  CHECK(store->TextureName(1) == "sky.exr");
  CHECK(store->textures()[1].layout == kSky);
  for (uint32_t t = 0; t < 2; ++t) {
    const TexelLayout layout = t == 0 ? kWood : kSky;
    const TextureShape shape(layout.width, layout.height);
    REQUIRE(store->textures()[t].pages.size() == shape.pages());
    for (uint32_t p = 0; p < shape.pages(); ++p)
      CHECK(store->ReadPage(t, p).value() == TexelsOf(shape, layout, p, 1));
  }
  const auto& uses = store->material_textures();
  REQUIRE(uses.size() == 3);
  const std::vector<Material> painted = Painted();
  CHECK(uses[0] == MaterialTexture{0, painted[0].textures[0]});
  CHECK(uses[1] == MaterialTexture{1, painted[1].textures[0]});
  CHECK(uses[2] == MaterialTexture{1, painted[1].textures[1]});
  CHECK(FaultOf(folder.file("s")) == "");
  CHECK(store->ReadPage(0, 99).error().message.find("there is no page 99 of texture 0") != std::string::npos);
  CHECK(store->ReadPage(2, 0).error().permanent());
}

TEST_CASE("The scene id covers texels and their uses", "[texture][store]") {
  const TemporaryFolder folder;
  const SceneId one = WriteStore(folder.file("a"));
  CHECK(WriteStore(folder.file("b")) == one);
  CHECK(ReadFile(folder.file("a")) == ReadFile(folder.file("b")));
  CHECK(WriteStore(folder.file("c"), 2) != one);
  std::vector<Material> other = Painted();
  other[1].textures[1].cutoff = 0.25f;
  CHECK(WriteStore(folder.file("d"), 1, other) != one);
}

TEST_CASE("A damaged page is named with its texture and byte", "[texture][store]") {
  const TemporaryFolder folder;
  WriteStore(folder.file("s"));
  const auto store = StoreReader::Open(folder.file("s"));
  const BlockEntry page = store->textures()[0].pages[3];
  auto bytes = ReadFile(folder.file("s"));
  bytes[page.offset + page.stored / 2] ^= 1;
  WriteFile(folder.file("bad"), bytes);
  const std::string fault = FaultOf(folder.file("bad"));
  CHECK(fault.find("page 3 of texture 0 (wood.png) at byte " + std::to_string(page.offset) +
                   ": is damaged (checksum)") != std::string::npos);
  const auto bad = StoreReader::Open(folder.file("bad"));
  CHECK_FALSE(bad->ReadPage(0, 3));
  CHECK(bad->ReadPage(0, 2));
}

TEST_CASE("Impossible directories of textures are refused", "[texture][store]") {
  Texture texture{"t", kWood, {}};
  const TextureShape shape(kWood.width, kWood.height);
  uint64_t at = 1000;
  for (uint32_t p = 0; p < shape.pages(); ++p) {
    texture.pages.push_back({at, 100, shape.TexelsOf(p) * 3, 7});
    at += 100;
  }
  const auto refused = [&](const Texture& t, uint64_t begin = 1000, uint64_t more = 0) -> std::string {
    std::string strings;
    const Bytes bytes = EncodeTextures({t}, strings);
    const auto decoded = DecodeTextures(bytes, begin, at + more);
    return decoded ? "" : decoded.error().message;
  };
  CHECK(refused(texture) == "");
  CHECK(refused(texture, 1001).find("texture 0 has a page of an invalid size or place") != std::string::npos);
  const auto changed = [&](auto&& change) {
    Texture t = texture;
    change(t);
    return refused(t);
  };
  CHECK_FALSE(changed([](Texture& t) { t.layout.width = 0; }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.layout.height = kMaxTextureSide + 1; }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.layout.channels = 5; }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.layout.format = static_cast<TexelFormat>(9); }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.pages.pop_back(); }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.pages.push_back(t.pages[0]); }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.pages[1].decoded += 1; }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.pages[1].stored = t.pages[1].decoded + 5; }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.pages[1].stored = 0; }).empty());
  CHECK_FALSE(changed([](Texture& t) { t.pages[1].offset = ~uint64_t{0} - 10; }).empty());
  // More textures than bytes.
  ByteWriter many;
  many.Put(uint32_t{60000});
  CHECK_FALSE(DecodeTextures(many.bytes(), 0, 0));
}

TEST_CASE("Impossible uses of textures are refused", "[texture][store]") {
  const auto refused = [](auto&& change) {
    std::vector<Material> materials = Painted();
    change(materials);
    return !DecodeMaterialTextures(EncodeMaterialTextures(materials), 2, 2).has_value();
  };
  CHECK_FALSE(refused([](auto&) {}));
  CHECK(refused([](auto& m) { m[0].textures[0].texture = 2; }));
  CHECK(refused([](auto& m) { m[0].textures[0].use = static_cast<TextureUse>(kTextureUses); }));
  CHECK(refused([](auto& m) { m[0].textures[0].wrap_t = static_cast<TextureWrap>(3); }));
  CHECK(refused([](auto& m) { m[0].textures[0].transform[4] = std::numeric_limits<float>::infinity(); }));
  CHECK(refused([](auto& m) { m[0].textures[0].factor.y = std::numeric_limits<float>::quiet_NaN(); }));
  CHECK(refused([](auto& m) { m.push_back(m[0]); }));
  CHECK(refused([](auto& m) { std::swap(m[1].textures[0], m[1].textures[1]); }));
  CHECK_FALSE(DecodeMaterialTextures(Bytes(63), 2, 2).has_value());
}

TEST_CASE("A store with textures: one flipped byte anywhere is found", "[texture][store]") {
  const TemporaryFolder folder;
  WriteStore(folder.file("s"));
  const auto whole = ReadFile(folder.file("s"));
  std::mt19937 random(11);
  for (int i = 0; i < 400; ++i) {
    auto bytes = whole;
    const size_t at = random() % bytes.size();
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << random() % 8));
    WriteFile(folder.file("bad"), bytes);
    CAPTURE(at);
    REQUIRE_FALSE(FaultOf(folder.file("bad")).empty());
  }
}

TEST_CASE("A directory of more pages than there may be is refused before any is read", "[texture][store]") {
  const auto fault = [](uint32_t textures) {
    ByteWriter out;
    out.Put(textures);
    for (uint32_t i = 0; i < textures; ++i)
      for (const uint32_t word : {0u, kMaxTextureSide, kMaxTextureSide, 3u, 0u}) out.Put(word);
    return DecodeTextures(out.bytes(), 0, 100).error().message;
  };
  const uint32_t pages = TextureShape(kMaxTextureSide, kMaxTextureSide).pages(), most = kMaxPages / pages;
  CHECK(fault(most + 1) == "the TEXD section has too many pages");
  CHECK(fault(most).find("the TEXD section's texture 0 has") == 0);
}

}  // namespace quarry
