#include "preprocess/import/obj/mtl.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

struct Read {
  std::vector<Material> materials;
  std::vector<std::vector<MtlTexture>> textures;
  std::vector<std::string> warnings;
};

Read ReadText(const std::string& text) {
  const TemporaryFolder folder;
  Read read;
  auto result = ReadMtl(folder.Write("a.mtl", text),
                        [&](std::string message) { read.warnings.push_back(std::move(message)); });
  REQUIRE(result);
  for (MtlMaterial& m : *result) {
    read.materials.push_back(std::move(m.material));
    read.textures.push_back(std::move(m.textures));
  }
  return read;
}

Material One(const std::string& statements) {
  const Read read = ReadText("newmtl m\n" + statements);
  REQUIRE(read.materials.size() == 1);
  return read.materials[0];
}

}  // namespace

TEST_CASE("MTL: metal and roughness, given or derived") {
  const Material shiny = One("Kd 0.5 0.25 0\nKs 0.5\nNs 198\nillum 2");
  CHECK(shiny.base_color == glm::vec3(0.5f, 0.25f, 0));
  CHECK(shiny.base_metalness == 0);
  CHECK(shiny.specular_roughness == Approx(std::sqrt(0.1)));
  CHECK((shiny.specular_weight == 1 && shiny.specular_ior == 1.5f && shiny.specular_color == glm::vec3(1)));
  const Material dull = One("Kd 0.5\nKs 0.1 0.2 0.3\nNs 10");
  CHECK(dull.specular_weight == Approx(0.4));
  CHECK(dull.specular_color.x == Approx(1 / 3.0));
  const Material bright = One("Kd 0.5\nKs 1\nNs 10");
  const float root = (bright.specular_ior - 1) / (bright.specular_ior + 1);
  CHECK((bright.specular_weight == 1 && root * root == Approx(0.08)));
  const Material mirror = One("Kd 0\nKs 0.75\nNs 1000\nillum 3");
  CHECK(mirror.base_metalness == 1);
  CHECK(mirror.base_color == glm::vec3(0.75f));
  const Material metal = One("Kd 1 0.5 0\nPm 1\nPr 0.5");
  CHECK((metal.base_metalness == 1 && metal.specular_roughness == 0.5f));
  CHECK(metal.reflectance == glm::vec3(0.25f, 0.125f, 0));
  const Material half = One("Kd 1 0.5 0\nd 0.5");
  CHECK((half.geometry_opacity == 0.5f && half.transmission_weight == 0));
  CHECK(half.base_color == glm::vec3(1, 0.5f, 0));
}

TEST_CASE("MTL: names, comments, clamping, defaults", "[import][mtl]") {
  const Read read = ReadText(
      "\xEF\xBB\xBF# c\r\nKd 1 1 1\r\n\tnewmtl  red paint \r\n KD 2 0.5 -1\r\nKs 0.25\r\nKe 5 nan 0\r\nNs "
      "99999\r\n"
      "Ka 1 1 1\r\nmap_Kd x.png\r\ncrazy_unknown 1\r\nnewmtl plain\r\nnewmtl last");
  REQUIRE(read.materials.size() == 3);
  const Material& red = read.materials[0];
  CHECK(red.name == "red paint");
  CHECK(red.diffuse == glm::vec3(1, 0.5f, 0));
  CHECK(red.specular == glm::vec3(0.25f));
  CHECK(red.emission == glm::vec3(5, 0, 0));
  CHECK(red.shininess == 10000);
  Material plain;
  plain.name = "plain";
  plain.is_open_pbr = false;
  CHECK(read.materials[1] == plain);
  CHECK(read.materials[2].name == "last");
  REQUIRE(read.warnings.size() == 1);
  CHECK_THAT(read.warnings[0],
             Catch::Contains("left out, since they are not read: MTL statements \"crazy_unknown\""));
}

TEST_CASE("MTL: unknown statements are left out with a warning", "[import][mtl]") {
  const Read read = ReadText("newmtl a\nKd spectral file.rfl\nNs high\nKs 1 1\nKd 0 0 0\n");
  REQUIRE(read.warnings.size() == 3);
  CHECK(read.warnings[1].ends_with("a.mtl, line 3: \"Ns high\" is not understood and left out"));
  CHECK(read.materials[0].diffuse == glm::vec3(0));
  CHECK(read.materials[0].specular == glm::vec3(0));
}

TEST_CASE("MTL: mirrors", "[import][mtl]") {
  CHECK(One("Ks 0.5\nillum 2").reflectance == glm::vec3(0));
  CHECK(One("Ks 0.5\nillum 3").reflectance == glm::vec3(0.5f));
  CHECK(One("Ks 0.5\nillum 8").reflectance == glm::vec3(0.5f));
  CHECK(One("Ks 0.5\nKr 0.25\nillum 3").reflectance == glm::vec3(0.25f));
  CHECK(One("Kr 0.25").reflectance == glm::vec3(0.25f));
  CHECK_FALSE(One("illum 3").fresnel);
  CHECK(One("Ks 1\nillum 5").fresnel);
  CHECK(One("Ks 1\nillum 9").reflectance == glm::vec3(0));
}

TEST_CASE("MTL: glass", "[import][mtl]") {
  const int illum = GENERATE(4, 6, 7, 9);
  const std::string model = "illum " + std::to_string(illum) + "\nNi 1.5\n";
  const Material clear = One(model);
  CHECK(clear.transmittance == glm::vec3(1));
  CHECK(clear.ior == 1.5f);
  CHECK(clear.fresnel == (illum == 7));
  CHECK(One(model + "Tf 0.5 1 1").transmittance == glm::vec3(0.5f, 1, 1));
  const Material half = One(model + "d 0.75\nTf 0.5 1 1\nKd 0.8 0.8 0.8");
  CHECK(half.transmittance == glm::vec3(0.5f, 1, 1));
  CHECK(One(model + "d 0.75").transmittance == glm::vec3(0.25f));
  CHECK(half.diffuse.x == Approx(0.8f));  // Tf alone states the light that passes
  CHECK(One(model + "d 0.75\nKd 0.8 0.8 0.8").diffuse.x == Approx(0.6f));
  CHECK(One(model + "Ni 0.5").ior == 1.0f);
}

TEST_CASE("MTL: dissolve passes straight through", "[import][mtl]") {
  const Material half = One("Kd 0.8\nd 0.25\nNi 1.5\nillum 2");
  CHECK(half.transmittance == glm::vec3(0.75f));
  CHECK(half.ior == 1.0f);
  CHECK(half.diffuse.x == Approx(0.2f));
  CHECK(One("Tr 0.75").transmittance == glm::vec3(0.75f));
  CHECK(One("Tr 1\nd 1").transmittance == glm::vec3(0));
  CHECK(One("d -halo 0.5").transmittance == glm::vec3(0.5f));
}

TEST_CASE("MTL: a missing file is an error", "[import][mtl]") {
  const auto result = ReadMtl("/nowhere/a.mtl", [](const std::string&) {});
  REQUIRE_FALSE(result);
  CHECK(result.error().message == "/nowhere/a.mtl: cannot be opened: No such file or directory");
}
