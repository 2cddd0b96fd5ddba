#include "preprocess/texture/texture_stage.h"

#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <fstream>

#include "common/voxel/store_reader.h"
#include "tests/support/models/made_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

void Write(const std::string& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

}  // namespace

TEST_CASE("From a model to texels: the image's texels are in the store, the upper row first", "[texture]") {
  ::signal(SIGPIPE, SIG_IGN);
  const test::TemporaryFolder folder;
  std::string texels;
  for (char c = 0; c < 45; ++c) texels.push_back(static_cast<char>(5 * c));
  Write(folder.file("five.ppm"), "P6 5 3 255\n" + texels);
  Write(folder.file("broken.ppm"), "P6 5 3 255\nx");
  Write(folder.file("a.mtl"),
        "newmtl bare\nnewmtl both\nmap_Ks broken.ppm\nmap_Kd -clamp on five.ppm\nmap_Ke five.ppm\n"
        "newmtl again\nmap_Kd five.ppm\n");
  Write(folder.file("a.obj"),
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl bare\nf 1 2 3\nusemtl both\nf 1/1 2/1 3/1\n"
        "usemtl again\nf 3/1 2/1 1/1\n");
  const PreprocessStatistics statistics =
      test::MakeStore({.models = {folder.file("a.obj")}, .output = folder.file("a.quarry")});
  CHECK(statistics.textures.textures == 1);  // one image, three uses
  CHECK(statistics.textures.left_out == 1);
  CHECK(statistics.warnings == 1);

  const auto store = StoreReader::Open(folder.file("a.quarry"));
  REQUIRE(store);
  REQUIRE(store->textures().size() == 1);
  CHECK(store->TextureName(0) == "five.ppm");
  CHECK(store->textures()[0].layout == TexelLayout{5, 3, 3, TexelFormat::kSrgb8});
  const Bytes page = store->ReadPage(0, 0).value();
  REQUIRE(page.size() == (15 + 2 + 1) * 3);
  CHECK(std::string(AsText(page)).substr(0, 45) == texels);
  const auto& uses = store->material_textures();
  REQUIRE(uses.size() == 3);
  CHECK(store->MaterialName(0) == "bare");
  CHECK(store->MaterialName(1) == "both");
  CHECK(store->MaterialName(2) == "again");
  CHECK((uses[0].material == 1 && uses[0].binding.use == TextureUse::kDiffuse));
  CHECK(uses[0].binding.wrap_s == TextureWrap::kClamp);
  CHECK((uses[1].material == 1 && uses[1].binding.use == TextureUse::kEmission));
  CHECK((uses[2].material == 2 && uses[2].binding.use == TextureUse::kDiffuse));
  CHECK(uses[2].binding.wrap_s == TextureWrap::kRepeat);
  for (const MaterialTexture& use : uses) CHECK(use.binding.texture == 0);
}

TEST_CASE("Images with the same texels are stored once, whatever their paths and forms", "[texture]") {
  ::signal(SIGPIPE, SIG_IGN);
  const test::TemporaryFolder folder;
  Write(folder.file("a.ppm"), "P6 2 1 255\nabcdef");
  Write(folder.file("copy.ppm"), "P6 2 1 255\nabcdef");             // the same bytes
  Write(folder.file("other.ppm"), "P6\n# words\n2 1 255\nabcdef");  // other bytes, the same texels
  Write(folder.file("tall.ppm"), "P6 1 2 255\nabcdef");  // the same bytes of texels, in another shape
  Write(folder.file("last.ppm"), "P6 2 1 255\nabcdeg");
  std::string library;
  for (const char* name : {"a", "copy", "other", "tall", "last", "a"})
    library += std::string("newmtl ") + name + "\nmap_Kd " + name + ".ppm\nmap_bump " + name + ".ppm\n";
  Write(folder.file("a.mtl"), library);
  std::string model = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
  for (const char* name : {"a", "copy", "other", "tall", "last"})
    model += std::string("usemtl ") + name + "\nf 1/1 2/1 3/1\n";
  Write(folder.file("a.obj"), model);
  const PreprocessStatistics statistics =
      test::MakeStore({.models = {folder.file("a.obj")}, .output = folder.file("a.quarry")});
  CHECK(statistics.textures.left_out == 0);
  const auto store = StoreReader::Open(folder.file("a.quarry"));
  REQUIRE(store);
  // Colours and heights are apart: the one is sRGB-encoded.
  std::vector<std::string> names;
  for (uint32_t t = 0; t < store->textures().size(); ++t) names.push_back(*store->TextureName(t));
  CHECK(names == std::vector<std::string>{"a.ppm", "a.ppm", "tall.ppm", "tall.ppm", "last.ppm", "last.ppm"});
  std::vector<uint32_t> numbers;
  for (const MaterialTexture& use : store->material_textures()) numbers.push_back(use.binding.texture);
  CHECK(numbers == std::vector<uint32_t>{0, 1, 0, 1, 0, 1, 2, 3, 4, 5});
}

TEST_CASE("A bump map that holds normals is a normal map", "[texture]") {
  ::signal(SIGPIPE, SIG_IGN);
  const test::TemporaryFolder folder;
  const auto image = [&](const char* name, std::string_view texels) {
    Write(folder.file(name), "P6 2 1 255\n" + std::string(texels));
  };
  image("normals.ppm", "\x90\x70\xF8\x78\x88\xFA");
  image("heights.ppm", "\x80\x80\x80\xFE\xFE\xFE");
  image("sky.ppm", "\x20\x40\xF8\x28\x48\xFA");
  Write(folder.file("a.mtl"),
        "newmtl a\nbump -bm 0.5 normals.ppm\nnewmtl b\nbump heights.ppm\nnewmtl c\nbump sky.ppm\n"
        "newmtl d\nbump normals.ppm\nnorm heights.ppm\n");
  Write(folder.file("a.obj"),
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\nusemtl b\nf 1/1 2/1 3/1\n"
        "usemtl c\nf 1/1 2/1 3/1\nusemtl d\nf 1/1 2/1 3/1\n");
  test::MakeStore({.models = {folder.file("a.obj")}, .output = folder.file("a.quarry")});
  const auto store = StoreReader::Open(folder.file("a.quarry"));
  REQUIRE(store);
  std::vector<std::pair<uint32_t, TextureUse>> uses;
  for (const MaterialTexture& use : store->material_textures())
    uses.emplace_back(use.material, use.binding.use);
  CHECK(uses == std::vector<std::pair<uint32_t, TextureUse>>{{0, TextureUse::kNormal},
                                                             {1, TextureUse::kBump},
                                                             {2, TextureUse::kBump},
                                                             {3, TextureUse::kNormal}});
  CHECK(store->material_textures()[0].binding.factor.x == 0.5f);
}

TEST_CASE("Images in a checkpoint are not imported again", "[texture]") {
  ::signal(SIGPIPE, SIG_IGN);
  const test::TemporaryFolder folder;
  Write(folder.file("a.ppm"), "P6 2 1 255\nabcdef");
  Write(folder.file("b.ppm"), "P6 2 1 255\n");
  Write(folder.file("c.ppm"), "P6 1 1 255\nxyz");
  Write(folder.file("d.ppm"), "P6 2 1 255\nabcdef");
  std::vector<TextureImage> images(4);
  for (size_t i = 0; i < images.size(); ++i) {
    images[i].name = std::string(1, static_cast<char>('a' + i)) + ".ppm";
    images[i].file = folder.file(images[i].name);
    images[i].model = "m";
  }
  const ImageDecoding decoding{std::string(QUARRY_BIN_DIR) + "/quarry-import-image", 64 << 20};
  auto writer = StoreWriter::Create(folder.file("s.quarry"));
  REQUIRE(writer);
  Progress progress(true);
  int warnings = 0;
  const auto warn = [&](const std::string&) { ++warnings; };
  TextureStage first(images, decoding, 1, warn);
  std::vector<Bytes> checkpoints;  // on a slow machine some come while it runs
  REQUIRE(first.Run(*writer, progress, [&](const Bytes& checkpoint) {
    checkpoints.push_back(checkpoint);
    return Status();
  }));
  CHECK(warnings == 1);
  checkpoints.push_back(first.TakeUnsaved(*writer));
  std::erase_if(checkpoints, [](const Bytes& checkpoint) { return checkpoint.empty(); });
  CHECK(first.TakeUnsaved(*writer).empty());

  // Nothing of them is there any more.
  for (const TextureImage& image : images) std::filesystem::remove(image.file);
  TextureStage again(images, decoding, 1, warn);
  std::vector<WrittenTexture> textures;
  for (const Bytes& checkpoint : checkpoints) REQUIRE(again.Restore(checkpoint, textures));
  REQUIRE(textures.size() == 2);
  CHECK((textures[0].texture.name == "a.ppm" && textures[1].texture.name == "c.ppm"));
  CHECK(textures[0].texture.layout == TexelLayout{2, 1, 3, TexelFormat::kSrgb8});
  REQUIRE(again.Run(*writer, progress, [](const Bytes&) { return Status(); }));
  CHECK(warnings == 1);
  Material material;
  for (uint32_t i = 0; i < 4; ++i) {
    TextureBinding binding;
    binding.texture = i;
    material.textures.push_back(binding);
  }
  std::vector<Material> materials{material};
  again.Renumber(materials, *writer);
  REQUIRE(materials[0].textures.size() == 3);
  CHECK((materials[0].textures[0].texture == 0 && materials[0].textures[1].texture == 1));
  CHECK(materials[0].textures[2].texture == 0);  // its texels equal the first texture's
  CHECK_FALSE(TextureStage(images, decoding, 1, warn).Restore(std::span(checkpoints[0]).first(20), textures));
}

}  // namespace quarry
