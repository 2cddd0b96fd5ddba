#include "common/scene/material_json.h"

#include <catch2/catch.hpp>
#include <sstream>

#include "tests/support/stores/every_material.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

Result<MaterialLibrary> Read(const std::string& text) {
  const test::TemporaryFolder folder;
  return ReadMaterialJson(folder.Write("m.json", text));
}

std::string Write(const MaterialLibrary& library) {
  std::ostringstream out;
  WriteMaterialJson(library, out);
  return out.str();
}

MaterialLibrary Example() {
  MaterialLibrary library;
  library.materials = {test::EveryMaterial("glass \"clear\""), Material{}};
  MaterialLibrary::Image image;
  image.file = "maps\\wood \"floor\".png";
  image.name = "wood";
  image.coordinates = 2;
  image.binding.use = TextureUse::kSpecular;
  image.binding.wrap_s = TextureWrap::kMirror;
  image.binding.wrap_t = TextureWrap::kClamp;
  image.binding.transform = {1.5f, 0.1f, 0.2f, 0.3f, -2.5f, 1.1f};
  image.binding.factor = {0.25f, 0.5f, 0.75f, 0.125f};
  image.binding.cutoff = 0.5f;
  MaterialLibrary::Image bump;
  bump.file = "b.png";
  bump.binding.use = TextureUse::kBump;
  library.images = {{image, bump}, {}};
  library.parts = {"boiler 1", "Kessel \xC3\xBC\n2", ""};
  return library;
}

TEST_CASE("Material json round trips every member") {
  const MaterialLibrary library = Example();
  const auto read = Read(Write(library));
  REQUIRE(read);
  CHECK(read->materials == library.materials);
  REQUIRE(read->images.size() == 2);
  REQUIRE(read->images[0].size() == 2);
  CHECK(read->images[1].empty());
  for (size_t k = 0; k < 2; ++k) {
    const auto &given = library.images[0][k], &got = read->images[0][k];
    CHECK((got.file == given.file && got.name == given.name && got.coordinates == given.coordinates));
    CHECK(got.binding == given.binding);
  }
  CHECK(read->parts == library.parts);
}

TEST_CASE("Material json is deterministic, short and in a fixed order") {
  MaterialLibrary library;
  library.materials.resize(1);
  library.materials[0].name = "steel";
  CHECK(Write(library) == Write(library));
  CHECK(Write(library) ==
        "{\"materials\": [\n  {\"name\":\"steel\",\"diffuse\":[0.8,0.8,0.8],\"specular\":[0.0,0.0,0.0],"
        "\"emission\":[0.0,0.0,0.0],\"reflectance\":[0.0,0.0,0.0],\"transmittance\":[0.0,0.0,0.0],"
        "\"shininess\":0.0,\"ior\":1.0,\"fresnel\":false,\"unlit\":false,\"base_color\":[0.8,0.8,0.8],"
        "\"base_metalness\":0.0,\"specular_roughness\":1.0,\"specular_weight\":0.0,"
        "\"specular_color\":[1.0,1.0,1.0],\"specular_ior\":1.5,\"transmission_weight\":0.0,"
        "\"transmission_color\":[1.0,1.0,1.0],\"transmission_depth\":0.0,\"geometry_opacity\":1.0}],"
        "\n\"parts\": []}\n");
}

TEST_CASE("Material json says which form the file gave where both agree") {
  MaterialLibrary library;
  library.materials.resize(2);
  library.materials[1].is_open_pbr = false;  // the same weights
  const std::string text = Write(library);
  CHECK(text.find("is_open_pbr") == text.rfind("\"is_open_pbr\":false") + 1);
  const auto read = Read(text);
  REQUIRE(read);
  CHECK(read->materials == library.materials);
}

TEST_CASE("Members of material json may be left out") {
  const auto read = Read(R"({"materials": [{"name": "plain"}, {"ior": 2}]})");
  REQUIRE(read);
  Material plain;
  plain.name = "plain";
  plain.is_open_pbr = false;  // neither form is there: the weights are
  REQUIRE(read->materials.size() == 2);
  CHECK(read->materials[0] == plain);
  CHECK(read->materials[1].ior == 2.0f);
  CHECK(read->parts.empty());
  CHECK(Read("{}"));
}

TEST_CASE("Material json clamps to ranges") {
  const auto read =
      Read(R"({"materials": [{"diffuse": [-1, 2, 0.5], "emission": [-1, 20, 0], "shininess": 1e9,
                             "ior": 0.5}, {"ior": 99, "shininess": -3}]})");
  REQUIRE(read);
  CHECK(read->materials[0].diffuse == glm::vec3(0.0f, 1.0f, 0.5f));
  CHECK(read->materials[0].emission == glm::vec3(0.0f, 20.0f, 0.0f));
  CHECK(read->materials[0].shininess == 10000.0f);
  CHECK(read->materials[0].ior == 1.0f);
  CHECK(read->materials[1].ior == 10.0f);
  CHECK(read->materials[1].shininess == 0.0f);
}

TEST_CASE("Errors of material json name the place") {
  const auto message = [](const std::string& text) {
    const auto read = Read(text);
    REQUIRE_FALSE(read);
    CHECK(read.error().exit_status() == 1);
    return read.error().message;
  };
  using Catch::Contains;
  CHECK_THAT(message("{\"materials\": [}"), Contains("byte 16"));
  CHECK_THAT(message(""), Contains("byte"));
  CHECK_THAT(message("[]"), Contains("object"));
  CHECK_THAT(message(R"({"materials": 3})"), Contains("materials"));
  CHECK_THAT(message(R"({"materials": [3]})"), Contains("materials[0]"));
  CHECK_THAT(message(R"({"materials": [{}, {"diffuse": [1, 2]}]})"), Contains("materials[1].diffuse"));
  CHECK_THAT(message(R"({"materials": [{"specular": [1, 2, "x"]}]})"), Contains("materials[0].specular"));
  CHECK_THAT(message(R"({"materials": [{"ior": "x"}]})"), Contains("materials[0].ior"));
  CHECK_THAT(message(R"({"materials": [{"name": 1}]})"), Contains("materials[0].name"));
  CHECK_THAT(message(R"({"materials": [{"fresnel": 1}]})"), Contains("materials[0].fresnel"));
  CHECK_THAT(message(R"({"materials": [{"ior": 1e99}]})"), Contains("JSON"));
  CHECK_THAT(message(R"({"parts": [1]})"), Contains("parts[0]"));
  CHECK_THAT(message(R"({"parts": {}})"), Contains("parts"));
}

TEST_CASE("A missing file of material json is an error") {
  const auto read = ReadMaterialJson("/nonexistent/model.materials.json");
  REQUIRE_FALSE(read);
  CHECK_THAT(read.error().message, Catch::Contains("No such file"));
}

TEST_CASE("Material json path replaces the extension") {
  CHECK(MaterialJsonPath("plant.ply") == "plant.materials.json");
  CHECK(MaterialJsonPath("a.b/plant.v2.ply") == "a.b/plant.v2.materials.json");
  CHECK(MaterialJsonPath("a.b/plant") == "a.b/plant.materials.json");
  CHECK(MaterialJsonPath(".hidden") == ".hidden.materials.json");
}

}  // namespace
TEST_CASE("Impossible textures of a material file are named") {
  const auto fault = [](const std::string& textures) {
    const auto read = Read("{\"materials\": [{\"name\": \"m\", \"textures\": " + textures + "}]}");
    return read ? "" : read.error().message;
  };
  CHECK(fault(R"([{"use": "normal", "file": "a.png"}])").empty());
  CHECK_THAT(fault("3"), Catch::Contains("materials[0].textures must be an array"));
  CHECK_THAT(fault("[3]"), Catch::Contains("materials[0].textures[0] is invalid"));
  const std::pair<const char*, const char*> kWrong[] = {
      {"use", R"({"file": "a"})"},
      {"use", R"({"use": "wood", "file": "a"})"},
      {"file", R"({"use": "bump"})"},
      {"file", R"({"use": "bump", "file": 3})"},
      {"name", R"({"use": "bump", "file": "a", "name": 3})"},
      {"coordinates", R"({"use": "bump", "file": "a", "coordinates": -1})"},
      {"coordinates", R"({"use": "bump", "file": "a", "coordinates": 256})"},
      {"wrap_s", R"({"use": "bump", "file": "a", "wrap_s": "round"})"},
      {"wrap_t", R"({"use": "bump", "file": "a", "wrap_t": 1})"},
      {"transform", R"({"use": "bump", "file": "a", "transform": [1, 2, 3, 4, 5]})"},
      {"factor", R"({"use": "bump", "file": "a", "factor": [1, 2, 3, "4"]})"},
      {"cutoff", R"({"use": "bump", "file": "a", "cutoff": "x"})"}};
  for (const auto& [member, text] : kWrong)
    CHECK_THAT(fault(std::string("[") + text + "]"),
               Catch::Contains(std::string("materials[0].textures[0].") + member + " is invalid"));
  CHECK_THAT(fault(R"([{"use": "bump", "file": "a"}, {"use": "bump", "file": "b"}])"),
             Catch::Contains("has two textures of one use"));
}

}  // namespace quarry
