#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "preprocess/import/obj/mtl_texture.h"
#include "tests/unit/recording_sink.h"

using namespace quarry;
using Json = nlohmann::json;

namespace {

const char* const kTriangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";

/// The binding for `use`, which must be there.
const TextureBinding& BindingOf(const Material& material, TextureUse use) {
  for (const TextureBinding& binding : material.textures)
    if (binding.use == use) return binding;
  FAIL("no texture for this use");
  return material.textures.front();
}

MtlTexture Parsed(std::string_view keyword, std::string_view text) {
  auto texture = MtlTextureFor(keyword);
  REQUIRE(texture);
  TextCursor rest(text);
  REQUIRE(ParseMtlTexture(rest, *texture));
  return *texture;
}

bool Refused(std::string_view text) {
  auto texture = MtlTextureFor("map_Kd");
  TextCursor rest(text);
  return !ParseMtlTexture(rest, *texture);
}

}  // namespace

TEST_CASE("MTL textures: names with blanks, quotes and options before them", "[import][texture]") {
  CHECK(Parsed("map_Kd", " wood floor 2.png ").file == "wood floor 2.png");
  CHECK(Parsed("map_Kd", "\"wood floor.png\"").file == "wood floor.png");
  CHECK(Parsed("MAP_KD", "-odd-name.png").file == "-odd-name.png");
  const MtlTexture all =
      Parsed("map_bump",
             "-s 2 3 1 -o 0.25 0.5 -clamp on -blendu off -texres 512 -bm 0.5 -mm 0 2 -imfchan g a b.png");
  CHECK(all.file == "a b.png");
  CHECK(all.binding.use == TextureUse::kBump);
  CHECK(all.pick == TexturePick::kGreen);
  CHECK(all.binding.wrap_s == TextureWrap::kClamp);
  CHECK(all.binding.factor.x == 1.0f);
  // v runs up in OBJ and down here.
  CHECK(all.binding.transform == std::array<float, 6>{2, 0, 0.25f, 0, -3, 0.5f});
  CHECK(all.left_out.empty());
  CHECK(Parsed("map_Kd", "-s 2 x.png").binding.transform[0] == 2);
  CHECK(Parsed("map_Kd", "-t 1 1 1 x.png").left_out == "-t");
  CHECK(Parsed("map_Kd", "-mm 0.1 1 x.png").left_out == "the base of -mm");
  CHECK(Parsed("map_Kd", "-imfchan z x.png").left_out == "-imfchan z");
  CHECK(Parsed("map_Kd", "-bm 0.25 x.png").binding.factor.x == 1);  // heights alone are multiplied
  CHECK(Parsed("map_d", "x.png").pick == TexturePick::kScalar);
  CHECK_FALSE(Parsed("map_d", "x.png").color);
  CHECK(Refused(""));
  CHECK(Refused("-s 1 1 1"));
  CHECK(Refused("-s two x.png"));
  CHECK(Refused("-o nan x.png"));
  CHECK(Refused("-imfchan q x.png"));
  CHECK_FALSE(MtlTextureFor("map_Ns"));
  CHECK_FALSE(MtlTextureFor("Kd"));
}

TEST_CASE("OBJ: images by their MTL, with the material's own colours", "[import][texture][obj]") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder.file("mats/maps"));
  folder.Write("mats/maps/wood.png", "not looked at yet");
  folder.Write("mats/leaf.png", "nor this");
  folder.Write("mats/a.mtl",
               "newmtl m\nKd 0.5 0.25 1\nd 0.5\nmap_Kd maps\\wood.png\nmap_Ke leaf.png\nmap_d leaf.png\n"
               "bump -bm 0.25 C:\\elsewhere\\leaf.png\n");
  RecordingSink sink;
  REQUIRE(ImportModel(folder.Write("a.obj", std::string("mtllib mats/a.mtl\n") + kTriangle), sink));
  CHECK(sink.warnings.empty());
  REQUIRE(sink.materials.size() == 1);
  const Material& m = sink.materials[0];
  CHECK(m.diffuse == glm::vec3(0.25f, 0.125f, 0.5f));
  REQUIRE(m.textures.size() == 4);
  REQUIRE(sink.images.size() == 4);
  const TextureBinding& kd = BindingOf(m, TextureUse::kDiffuse);
  CHECK(kd.factor == glm::vec4(0.5f, 0.25f, 1, 0.5f));
  const TextureImage& wood = sink.images[kd.texture];
  CHECK(std::filesystem::equivalent(wood.file, folder.file("mats/maps/wood.png")));
  CHECK(wood.name == "maps\\wood.png");
  CHECK(wood.model == folder.file("mats/a.mtl"));
  CHECK((wood.color && wood.pick == TexturePick::kColor));
  // Light without a colour of its own is the image's.
  CHECK(BindingOf(m, TextureUse::kEmission).factor == glm::vec4(1));
  const TextureBinding& mask = BindingOf(m, TextureUse::kOpacity);
  CHECK(mask.factor.a == 0.5f);
  CHECK_FALSE(sink.images[mask.texture].color);
  CHECK(BindingOf(m, TextureUse::kBump).factor.x == 0.25f);
}

TEST_CASE("OBJ: a missing image is one warning, and the material has no texture", "[import][texture][obj]") {
  const TemporaryFolder folder;
  folder.Write("a.mtl", "newmtl m\nKd 1 0 0\n\nmap_Kd gone.png\nnewmtl unused\nmap_Kd gone too.png\n");
  RecordingSink sink;
  REQUIRE(ImportModel(
      folder.Write("a.obj", std::string("mtllib a.mtl\n") + kTriangle + "usemtl m\nf 1 2 3\n"), sink));
  REQUIRE(sink.warnings.size() == 1);
  CHECK(sink.warnings[0] ==
        folder.file("a.mtl") + ", line 4: the image \"gone.png\" is not there; the material does without it");
  REQUIRE(sink.materials.size() == 1);
  CHECK(sink.materials[0].textures.empty());
  CHECK(sink.materials[0].diffuse == glm::vec3(1, 0, 0));
}

namespace {

/// A triangle with one material, as glTF; `bytes` is more of its buffer.
struct Document {
  Json json = {{"asset", {{"version", "2.0"}}}};
  std::string buffer;

  Document() {
    const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    buffer.assign(reinterpret_cast<const char*>(positions), sizeof positions);
    json["bufferViews"] = {{{"buffer", 0}, {"byteLength", buffer.size()}}};
    json["accessors"] = {{{"bufferView", 0}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}}};
    json["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"material", 0}}}}}};
    json["nodes"] = {{{"mesh", 0}}};
    json["materials"] = {{{"name", "m"}, {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
    json["textures"] = {{{"source", 0}}};
  }
  size_t View(const std::string& bytes) {
    json["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", bytes.size()}});
    buffer += bytes;
    while (buffer.size() % 4 != 0) buffer.push_back('\0');
    return json["bufferViews"].size() - 1;
  }
  std::string Glb() {
    json["buffers"] = {{{"byteLength", buffer.size()}}};
    std::string text = json.dump();
    while (text.size() % 4 != 0) text.push_back(' ');
    std::string out = "glTF";
    const auto put = [&](size_t word) {
      const auto value = static_cast<uint32_t>(word);
      out.append(reinterpret_cast<const char*>(&value), 4);
    };
    put(2);
    put(28 + text.size() + buffer.size());
    put(text.size());
    out += "JSON" + text;
    put(buffer.size());
    return out + std::string("BIN\0", 4) + buffer;
  }
  /// Imports the document, with the files beside it.
  RecordingSink Import(const TemporaryFolder& folder) {
    RecordingSink sink;
    const Status status = ImportModel(folder.Write("m.glb", Glb()), sink);
    INFO((status ? "" : status.error().message));
    REQUIRE(status);
    REQUIRE(sink.materials.size() == 1);
    return sink;
  }
};

std::string Text(const Bytes& bytes) { return std::string(AsText(bytes)); }

}  // namespace

TEST_CASE("glTF: images in files, in the buffer, in the JSON", "[import][texture][gltf]") {
  const TemporaryFolder folder;
  folder.Write("wood floor.png", "the file");
  Document d;
  d.json["images"] = {{{"uri", "wood%20floor.png"}},
                      {{"bufferView", d.View("the view")}, {"mimeType", "image/png"}, {"name", "roughness"}},
                      {{"uri", "data:image/png;base64,dGhlIHRleHQ="}}};
  d.json["samplers"] = {{{"wrapS", 33071}, {"wrapT", 33648}}};
  d.json["textures"] = {{{"source", 0}, {"sampler", 0}}, {{"source", 1}}, {{"source", 2}}};
  Json& m = d.json["materials"][0];
  m["pbrMetallicRoughness"]["baseColorFactor"] = {0.5, 1, 0.25, 0.75};
  m["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {{"index", 1}};
  m["pbrMetallicRoughness"]["roughnessFactor"] = 0.5;
  m["emissiveTexture"] = {{"index", 2}};
  m["emissiveFactor"] = {0, 0.5, 1};
  m["normalTexture"] = {{"index", 2}, {"scale", 0.25}};
  const RecordingSink sink = d.Import(folder);
  CHECK(sink.warnings.empty());
  const Material& material = sink.materials[0];
  REQUIRE(material.textures.size() == 4);

  const TextureBinding& base = BindingOf(material, TextureUse::kDiffuse);
  CHECK(base.factor == glm::vec4(0.5f, 1, 0.25f, 0.75f));
  CHECK(base.wrap_s == TextureWrap::kClamp);
  CHECK(base.wrap_t == TextureWrap::kMirror);
  CHECK(base.transform == std::array<float, 6>{1, 0, 0, 0, 1, 0});
  const TextureImage& file = sink.images[base.texture];
  CHECK(file.file == folder.file("wood floor.png"));
  CHECK((file.color && file.pick == TexturePick::kColor));

  const TextureBinding& rough = BindingOf(material, TextureUse::kMetalRoughness);
  CHECK((rough.factor.g == 0.5f && rough.factor.b == 1));
  const TextureImage& view = sink.images[rough.texture];
  CHECK_FALSE(view.color);
  CHECK(view.name == "roughness");
  std::ifstream glb(view.file, std::ios::binary);
  glb.seekg(static_cast<std::streamoff>(view.offset));
  std::string bytes(view.size, '\0');
  glb.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  CHECK(bytes == "the view");

  // One image for two uses: colour and numbers.
  const TextureBinding &light = BindingOf(material, TextureUse::kEmission),
                       &normal = BindingOf(material, TextureUse::kNormal);
  CHECK(light.factor == glm::vec4(0, 0.5f, 1, 1));
  CHECK(normal.factor.x == 0.25f);
  CHECK(light.texture != normal.texture);
  CHECK(Text(sink.images[light.texture].content) == "the text");
  CHECK(sink.images[light.texture].name == "images[2]");
  CHECK_FALSE(sink.images[normal.texture].color);
}

TEST_CASE("glTF: alpha is carried where it is used, and once", "[import][texture][gltf]") {
  for (const char* mode : {"OPAQUE", "MASK", "BLEND"}) {
    const TemporaryFolder folder;
    folder.Write("a.png", "x");
    Document d;
    d.json["images"] = {{{"uri", "a.png"}}};
    d.json["materials"][0]["alphaMode"] = mode;
    const RecordingSink sink = d.Import(folder);
    const bool opaque = mode == std::string("OPAQUE");
    REQUIRE(sink.images.size() == 1);
    CHECK(sink.images[0].pick == (opaque ? TexturePick::kColor : TexturePick::kColorAndAlpha));
    CHECK(sink.materials[0].textures.size() == (opaque ? 1 : 2));
    if (opaque) continue;
    CHECK(BindingOf(sink.materials[0], TextureUse::kOpacity).cutoff ==
          (mode == std::string("MASK") ? 0.5f : 0.0f));
  }
}

TEST_CASE("glTF: texture coordinates scaled, turned and moved", "[import][texture][gltf]") {
  const TemporaryFolder folder;
  folder.Write("a.png", "x");
  Document d;
  d.json["images"] = {{{"uri", "a.png"}}};
  d.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"] =
      {{"offset", {0.5, 0.25}}, {"rotation", 1.5707963267948966}, {"scale", {2, 3}}};
  const RecordingSink sink = d.Import(folder);
  const std::array<float, 6> wanted{0, 3, 0.5f, -2, 0, 0.25f};
  for (size_t i = 0; i < 6; ++i)
    CHECK(sink.materials[0].textures[0].transform[i] == Approx(wanted[i]).margin(1e-6));
}

TEST_CASE("glTF: a triangle carries the coordinates of its base colour", "[import][texture][gltf]") {
  const TemporaryFolder folder;
  folder.Write("a.png", "x");
  Document d;
  d.json["images"] = {{{"uri", "a.png"}}};
  nlohmann::json& material = d.json["materials"][0];
  material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1;
  material["emissiveTexture"] = {{"index", 0}, {"texCoord", 1}};
  const RecordingSink one = d.Import(folder);
  CHECK(one.materials[0].textures.size() == 2);
  CHECK(one.warnings.empty());
  // Once a material, however many of its textures go by other coordinates.
  material["emissiveTexture"]["texCoord"] = 0;
  material["normalTexture"] = {{"index", 0}, {"texCoord", 2}};
  const RecordingSink mixed = d.Import(folder);
  CHECK(mixed.materials[0].textures.size() == 1);
  REQUIRE(mixed.warnings.size() == 1);
  CHECK_THAT(mixed.warnings[0], Catch::Contains("more than one set of texture coordinates") &&
                                    Catch::Contains("carries only TEXCOORD_1"));
}

TEST_CASE("glTF: each unsupported feature of textures is one warning", "[import][texture][gltf]") {
  const auto warning = [](auto&& change) {
    const TemporaryFolder folder;
    folder.Write("a.png", "x");
    Document d;
    d.json["images"] = {{{"uri", "a.png"}}};
    change(d);
    const RecordingSink sink = d.Import(folder);
    CHECK(sink.materials[0].textures.empty());
    REQUIRE(sink.warnings.size() == 1);
    CHECK(sink.warnings[0].find(folder.file("m.glb") + ": ") == 0);
    return sink.warnings[0];
  };
  using Catch::Contains;
  CHECK_THAT(warning([](Document& d) { d.json["images"][0]["uri"] = "gone.png"; }),
             Contains("the image \"gone.png\" is not there"));
  CHECK_THAT(warning([](Document& d) { d.json["images"][0]["uri"] = "data:image/png;base64,###"; }),
             Contains("images[0]: its data: URI is not base64"));
  CHECK_THAT(warning([](Document& d) { d.json["images"][0]["uri"] = "data:image/png;base64,"; }),
             Contains("images[0] is empty"));
  CHECK_THAT(warning([](Document& d) {
               d.json["images"][0] = {{"bufferView", 7}};
             }),
             Contains("bufferViews[7] is not there"));
  CHECK_THAT(warning([](Document& d) {
               d.json["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", 30}, {"byteLength", 1000}});
               d.json["images"][0] = {{"bufferView", 1}};
             }),
             Contains("buffers[0] ends at byte"));
  CHECK_THAT(warning([](Document& d) { d.json["textures"][0]["source"] = 3; }),
             Contains("images[3] is not there"));
  CHECK_THAT(warning([](Document& d) { d.json["textures"][0].erase("source"); }),
             Contains("textures[0] has no image of a format that is read"));
  CHECK_THAT(warning([](Document& d) {
               d.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = -1;
             }),
             Contains("index is not a whole number"));
  CHECK_THAT(warning([](Document& d) {
               d.json["samplers"] = {{{"wrapS", 1}}};
               d.json["textures"][0]["sampler"] = 0;
             }),
             Contains("a sampler's wrapS of 1 is unknown"));
  CHECK_THAT(warning([](Document& d) { d.json["images"][0]["uri"] = 7; }),
             Contains("a texture or its image cannot be read"));
  CHECK_THAT(warning([](Document& d) { d.json["images"][0]["uri"] = "/etc/hostname"; }),
             Contains("\"/etc/hostname\" is named by an absolute path"));
}

TEST_CASE("glTF, MTL: numbers out of bounds are clamped to the range of a store", "[import][texture]") {
  const TemporaryFolder folder;
  folder.Write("a.png", "x");
  Document d;
  d.json["images"] = {{{"uri", "a.png"}}};
  Json& m = d.json["materials"][0];
  m["emissiveTexture"] = {{"index", 0}};
  m["emissiveFactor"] = {1, 1, 1};
  m["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = 1e300;
  m["normalTexture"] = {{"index", 0}, {"scale", -1e300}};
  const RecordingSink gltf = d.Import(folder);
  CHECK(BindingOf(gltf.materials[0], TextureUse::kEmission).factor.x == 1e30f);
  CHECK(BindingOf(gltf.materials[0], TextureUse::kNormal).factor.x == -1e30f);
  CHECK(gltf.materials[0].emission.x == 1e30f);

  folder.Write("a.mtl", "newmtl m\nbump -bm 1e20 -mm 0 1e20 a.png\nKe 0\nmap_Ke -mm 0 1e30 a.png\n");
  RecordingSink obj;
  REQUIRE(ImportModel(folder.Write("a.obj", std::string("mtllib a.mtl\n") + kTriangle), obj));
  REQUIRE(obj.materials[0].textures.size() == 2);
  CHECK(BindingOf(obj.materials[0], TextureUse::kBump).factor.x == 1e30f);
  CHECK(Bounded(std::numeric_limits<float>::quiet_NaN()) == 0);
}
