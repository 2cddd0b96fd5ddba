// The generators write the same materials into OBJ+MTL and into PLY+JSON: reading either must give the same.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <map>

#include "common/scene/material_json.h"
#include "preprocess/import/obj/mtl.h"

namespace quarry {

TEST_CASE("A generated scene has the same materials as OBJ and as PLY") {
  std::string folder = (std::filesystem::temp_directory_path() / "quarry-agree-XXXXXX").string();
  REQUIRE(mkdtemp(folder.data()) != nullptr);
  for (const std::string kind : {"cornell", "plant", "city"}) {
    for (const std::string extension : {".obj", ".ply"}) {
      const std::string command = std::string(QUARRY_BIN_DIR) + "/quarry-scene " + kind +
                                  " --triangles 20000 --quiet -o " + folder + "/" + kind + extension;
      REQUIRE(std::system(command.c_str()) == 0);
    }
    const auto json = ReadMaterialJson(folder + "/" + kind + ".materials.json");
    const auto mtl = ReadMtl(folder + "/" + kind + ".mtl", [](const std::string& text) { FAIL(text); });
    REQUIRE(json.has_value());
    REQUIRE(mtl.has_value());
    std::map<std::string, Material> by_name;
    for (const MtlMaterial& m : *mtl) by_name[m.material.name] = m.material;
    for (const Material& m : json->materials) {
      INFO(kind << ": " << m.name);
      REQUIRE(by_name.count(m.name) == 1);
      const Material& o = by_name[m.name];
      for (int c = 0; c < 3; ++c) {
        CHECK(o.diffuse[c] == Approx(m.diffuse[c]).margin(1e-6));
        CHECK(o.reflectance[c] == Approx(m.reflectance[c]).margin(1e-6));
        CHECK(o.transmittance[c] == Approx(m.transmittance[c]).margin(1e-6));
        CHECK(o.emission[c] == Approx(m.emission[c]).margin(1e-6));
        CHECK(o.specular[c] == Approx(m.specular[c]).margin(1e-6));
      }
      CHECK(o.fresnel == m.fresnel);
      CHECK(o.shininess == Approx(m.shininess));
      if (m.transmittance != glm::vec3(0)) CHECK(o.ior == Approx(m.ior));
    }
  }
  std::filesystem::remove_all(folder);
}

}  // namespace quarry
