// The generators write the same materials into OBJ+MTL and into PLY+JSON: reading either must give the same.
#include <catch2/catch.hpp>
#include <map>

#include "common/scene/material_json.h"
#include "preprocess/import/obj/mtl.h"
#include "tests/support/models/made_store.h"

namespace quarry {

TEST_CASE("A generated scene has the same materials as OBJ and as PLY") {
  const test::TemporaryFolder folder;
  for (const std::string kind : {"cornell", "plant", "city"}) {
    for (const char* extension : {".obj", ".ply"}) test::GenerateScene(folder, kind, 20000, extension);
    const auto json = ReadMaterialJson(folder.file(kind + ".materials.json"));
    const auto mtl = ReadMtl(folder.file(kind + ".mtl"), [](const std::string& text) { FAIL(text); });
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
}

}  // namespace quarry
