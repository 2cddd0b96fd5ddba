// 3MF: objects, components, materials and colours, and the archive around them.

#include <catch2/catch.hpp>

#include "tests/unit/recording_sink.h"
#include "tests/unit/three_mf_builder.h"

using namespace quarry;

namespace {

std::string Square(const std::string& build = Item(1)) {
  return ThreeMfModel(ThreeMfObject(1, SquareMesh()), build);
}

/// The error of a model, or "".
std::string ErrorOfModel(const std::string& model) { return ErrorOf("a.3mf", Zip(ThreeMfParts(model))); }

struct Read {
  RecordingSink sink;
  std::string error;
  explicit Read(const std::string& model) : error(ImportText("a.3mf", Zip(ThreeMfParts(model)), sink)) {
    INFO(error);
    CHECK(error.empty());
  }
  glm::dvec3 At(size_t polygon, size_t corner) const {
    return sink.positions[sink.polygons[polygon].corners[corner].position];
  }
};

const glm::vec3 kRed(1, 0, 0);

}  // namespace

TEST_CASE("3MF: an item's transform moves its object", "[import][3mf]") {
  const Read read(Square(Item(1, "transform=\"0 2 0 -2 0 0 0 0 1 10 20 30\"")));
  CHECK(read.sink.triangles == 2);
  CHECK(read.At(0, 0) == glm::dvec3(10, 20, 30));
  CHECK(read.At(0, 1) == glm::dvec3(10, 22, 30));
  CHECK(read.At(0, 2) == glm::dvec3(8, 22, 30));
  CHECK(read.sink.ended);
  CHECK(read.sink.warnings.empty());
}

TEST_CASE("3MF: a mirror turns the triangles", "[import][3mf]") {
  const Read read(Square(Item(1, "transform=\"-1 0 0 0 1 0 0 0 1 0 0 0\"")));
  CHECK(read.At(0, 1) == glm::dvec3(-1, 1, 0));
  CHECK(read.At(0, 2) == glm::dvec3(-1, 0, 0));
}

TEST_CASE("3MF: components lie in components, each with its transform", "[import][3mf]") {
  const std::string objects =
      ThreeMfObject(1, SquareMesh(), "name=\"Leaf\"") + ThreeMfObject(2, SquareMesh()) +
      ThreeMfObject(3, Components(Component(1) + Component(2, Moved("2 0 0"))), "name=\"Pair\"") +
      ThreeMfObject(4, Components(Component(3) + Component(3, "transform=\"2 0 0 0 2 0 0 0 2 0 10 0\"")));
  const Read read(ThreeMfModel(objects, Item(4, Moved("100 0 0"))));
  CHECK(read.sink.triangles == 8);
  // Object by object, instances in the order of the file.
  CHECK(read.At(0, 1) == glm::dvec3(101, 0, 0));
  CHECK(read.At(2, 1) == glm::dvec3(102, 10, 0));
  CHECK(read.At(4, 1) == glm::dvec3(103, 0, 0));
  CHECK(read.At(6, 1) == glm::dvec3(106, 10, 0));
  CHECK(read.sink.parts == std::vector<std::string>{"Pair", "Pair/Leaf"});
  CHECK(read.sink.polygons[0].part == 1);
  CHECK(read.sink.polygons[4].part == 0);
}

TEST_CASE("3MF: an object too large for memory is passed on for all instances at once", "[import][3mf]") {
  std::string mesh = "<mesh><vertices>";
  const int vertices = 70'000;
  for (int i = 0; i < vertices; ++i) {
    mesh += "<vertex x=\"" + std::to_string(i) + "\" y=\"" + std::to_string(i % 2) + "\" z=\"0\"/>";
  }
  mesh += "</vertices><triangles><triangle v1=\"0\" v2=\"1\" v3=\"69999\"/></triangles></mesh>";
  const Read read(ThreeMfModel(ThreeMfObject(1, mesh) + ThreeMfObject(2, SquareMesh()),
                               Item(1) + Item(2) + Item(1, Moved("0 0 5")) + Item(2, Moved("0 0 7"))));
  CHECK(read.sink.positions.size() == 2 * vertices + 8);
  CHECK(read.sink.triangles == 6);
  CHECK(read.At(0, 2) == glm::dvec3(69999, 1, 0));
  CHECK(read.At(1, 2) == glm::dvec3(69999, 1, 5));
  CHECK(read.At(2, 1) == glm::dvec3(1, 0, 0));
  CHECK(read.At(4, 1) == glm::dvec3(1, 0, 7));
}

TEST_CASE("3MF: base materials are an object's, a triangle's first", "[import][3mf]") {
  const std::string materials =
      "<basematerials id=\"7\"><base name=\"Red\" displaycolor=\"#FF0000\"/>"
      "<base name=\"Glass\" displaycolor=\"#FFFFFF80\"/><base name=\"Plain\"/></basematerials>";
  const Read read(ThreeMfModel(
      materials + ThreeMfObject(1, SquareMesh("", "pid=\"7\" p1=\"1\""), "pid=\"7\" pindex=\"0\""), Item(1)));
  REQUIRE(read.sink.materials.size() == 3);
  CHECK(read.sink.materials[0].name == "Red");
  CHECK(read.sink.materials[0].diffuse == kRed);
  CHECK(read.sink.materials[1].transmittance.x == Approx(127 / 255.0));
  CHECK(read.sink.materials[2].diffuse.x == Approx(0.8).epsilon(0.01));
  CHECK(read.sink.polygons[0].material == 0);
  CHECK(read.sink.polygons[1].material == 1);
}

TEST_CASE("3MF: colours of groups are sRGB, for a triangle or for its corners", "[import][3mf]") {
  const std::string colors =
      "<m:colorgroup id=\"9\"><m:color color=\"#808080\"/><m:color color=\"#ff0000FF\"/>"
      "<m:color color=\"#0000FF\"/></m:colorgroup>";
  const Read read(ThreeMfModel(
      colors + ThreeMfObject(1, SquareMesh("p1=\"1\" p2=\"1\" p3=\"2\"", ""), "pid=\"9\" pindex=\"0\""),
      Item(1)));
  CHECK(read.sink.polygons[1].color.r == 55);
  CHECK(Packed(read.sink.polygons[0].color) == Packed(Rgba8()));
  const auto& corners = read.sink.polygons[0].corners;
  CHECK(Packed(read.sink.colors[corners[1].position]) == Packed(Rgba8{255, 0, 0, 255}));
  CHECK(Packed(read.sink.colors[corners[2].position]) == Packed(Rgba8{0, 0, 255, 255}));
  CHECK(read.At(0, 2) == glm::dvec3(1, 1, 0));
}

TEST_CASE("3MF: missing properties give a warning and the default", "[import][3mf]") {
  const std::string colors = "<m:colorgroup id=\"9\"><m:color color=\"#808080\"/></m:colorgroup>";
  const Read read(ThreeMfModel(
      colors + ThreeMfObject(1, SquareMesh("pid=\"9\" p1=\"1\"", "pid=\"8\" p1=\"0\"")), Item(1)));
  CHECK(read.sink.polygons[0].material == kNoIndex);
  REQUIRE(read.sink.warnings.size() == 1);
  CHECK_THAT(read.sink.warnings[0],
             Catch::Contains("2 triangles have a material or colour that is not there"));
  const Read unused(ThreeMfModel(colors + ThreeMfObject(1, SquareMesh()), Item(1)));
  CHECK(unused.sink.warnings.size() == 1);
}

TEST_CASE("3MF: textures, mixtures, lattices and slices are left out with a warning", "[import][3mf]") {
  const std::string resources =
      "<m:texture2d id=\"3\" path=\"/a.png\" contenttype=\"image/png\"/><m:texture2dgroup id=\"4\" "
      "texid=\"3\">"
      "<m:tex2coord u=\"0\" v=\"0\"/></m:texture2dgroup>";
  std::string mesh = SquareMesh();
  mesh.insert(mesh.find("</mesh>"),
              "<b:beamlattice><b:beams><b:beam v1=\"0\" v2=\"1\"/></b:beams></b:beamlattice>");
  const Read read(ThreeMfModel(resources + ThreeMfObject(1, mesh, "pid=\"4\" pindex=\"0\""), Item(1)));
  CHECK(read.sink.triangles == 2);
  std::string all;
  for (const std::string& warning : read.sink.warnings) all += warning + "\n";
  for (const char* said : {"\"texture2d\" left out", "beams of lattices left out", "2 triangles have"})
    CHECK_THAT(all, Catch::Contains(said));
}

TEST_CASE("3MF: the production extension's objects lie in other parts, with units of their own",
          "[import][3mf]") {
  ZipParts parts = ThreeMfParts(ThreeMfModel(
      ThreeMfObject(1, Components(Component(5, "p:path=\"/3D/Objects/object%201.model\"") +
                                  Component(5, "p:path=\"/3D/Objects/object%201.model\" " + Moved("0 0 9")))),
      Item(1) + Item(5, "p:path=\"/3d/objects/INCH.model\""),
      "unit=\"centimeter\" requiredextensions=\"p\""));
  parts.emplace_back("3D/Objects/object 1.model",
                     ThreeMfModel(ThreeMfObject(5, SquareMesh()), "", "unit=\"centimeter\""));
  parts.emplace_back("3D/Objects/inch.model",
                     ThreeMfModel(ThreeMfObject(5, SquareMesh()), "", "unit=\"inch\""));
  RecordingSink sink;
  CHECK(ImportText("a.3mf", Zip(parts), sink) == "");
  CHECK(sink.warnings.empty());
  REQUIRE(sink.positions.size() == 12);
  CHECK(sink.positions[6] == glm::dvec3(1, 1, 9));
  CHECK(sink.positions[10].x == Approx(2.54));
  parts.pop_back();
  CHECK_THAT(ErrorOf("a.3mf", Zip(parts)), Catch::Contains("INCH.model\" is not in the archive"));
}

TEST_CASE("3MF: a build without items shows all objects that no other holds", "[import][3mf]") {
  const std::string objects = ThreeMfObject(1, SquareMesh()) + ThreeMfObject(2, Components(Component(1)));
  const Read read(ThreeMfModel(objects, ""));
  CHECK(read.sink.triangles == 2);
  REQUIRE(read.sink.warnings.size() == 1);
  CHECK_THAT(read.sink.warnings[0], Catch::Contains("its build shows no object"));
}

TEST_CASE("3MF: component bombs are refused before the first triangle", "[import][3mf]") {
  std::string objects = ThreeMfObject(1, SquareMesh());
  for (int id = 2; id < 12; ++id) {
    std::string ten;
    for (int i = 0; i < 10; ++i) ten += Component(id - 1);
    objects += ThreeMfObject(id, Components(ten));
  }
  RecordingSink sink;
  CHECK(ImportText("a.3mf", Zip(ThreeMfParts(ThreeMfModel(objects, Item(11)))), sink) ==
        "a.3mf: shows its objects 10000000000 times in all, by components in components; at most 1000000 "
        "instances are read");
  CHECK(sink.positions.empty());
  std::string chain = ThreeMfObject(1, SquareMesh());
  for (int id = 2; id < 200; ++id) chain += ThreeMfObject(id, Components(Component(id - 1)));
  CHECK_THAT(ErrorOfModel(ThreeMfModel(chain, Item(199))), Catch::Contains("64 components deep"));
  CHECK_THAT(
      ErrorOfModel(ThreeMfModel(
          ThreeMfObject(1, Components(Component(2))) + ThreeMfObject(2, Components(Component(1))), Item(1))),
      Catch::Contains("lies within itself"));
}

TEST_CASE("3MF: XML that grows or is damaged is refused", "[import][3mf]") {
  const std::string good = Square();
  const std::string xml = "<?xml version=\"1.0\"?>";
  CHECK_THAT(ErrorOfModel(xml + "<!DOCTYPE model [<!ENTITY a \"aaa\">]><model/>"),
             Catch::Contains("line 1") && Catch::Contains("DOCTYPE"));
  std::string deep = xml + "<model>";
  for (int i = 0; i < 1000; ++i) deep += "<a>";
  CHECK_THAT(ErrorOfModel(deep), Catch::Contains("100 deep"));
  std::string names = xml + "<model>";
  for (int i = 0; i < 300'000; ++i) names += "<a" + std::to_string(i) + "/>";
  CHECK_THAT(ErrorOfModel(names), Catch::Contains("16 MiB"));
  CHECK_THAT(ErrorOfModel(xml + "<model name=\"" + std::string(20 << 20, 'a') + "\"/>"),
             Catch::Contains("16 MiB"));
  CHECK_THAT(ErrorOfModel(good.substr(0, good.size() - 3)), Catch::Contains("XML is damaged"));
  CHECK_THAT(ErrorOfModel("<html/>"), Catch::Contains("begins with \"html\""));
  CHECK_THAT(ErrorOfModel(""), Catch::Contains("XML is damaged"));
}

TEST_CASE("3MF: wrong numbers and references get one sentence with the place", "[import][3mf]") {
  const auto with = [](const std::string& old, const std::string& text) {
    std::string model = Square(Item(1, Moved("0 0 0")));
    model.replace(model.find(old), old.size(), text);
    return ErrorOfModel(model);
  };
  CHECK(with("v3=\"3\"", "v3=\"4\"").find("a.3mf: 3D/3dmodel.model, line 4, column ") == 0);
  CHECK_THAT(with("v3=\"3\"", "v3=\"4\""), Catch::EndsWith("vertex 4, but object 1 has only 4, from 0"));
  CHECK_THAT(with("v3=\"3\"", "v3=\"-1\""), Catch::Contains("needs v1, v2 and v3"));
  CHECK_THAT(with("v3=\"3\"", ""), Catch::Contains("needs v1, v2 and v3"));
  CHECK_THAT(with("x=\"1\"", "x=\"1,5\""), Catch::Contains("needs the numbers x, y and z"));
  CHECK_THAT(with("1 0 0 0", "1 0 0"), Catch::Contains("not twelve numbers"));
  CHECK_THAT(with("1 0 0 0", "nan 0 0 0"), Catch::Contains("not twelve numbers"));
  CHECK_THAT(with("objectid=\"1\"", "objectid=\"2\""),
             Catch::Contains("the build shows object 2, which is not there"));
  CHECK_THAT(with("objectid=\"1\"", ""), Catch::Contains("needs an objectid"));
  CHECK_THAT(with("<triangles>", "<nothing>"), Catch::Contains("XML is damaged"));
  CHECK_THAT(with("object id=\"1\"", "object id=\"one\""), Catch::Contains("needs an id"));
  CHECK_THAT(
      ErrorOfModel(ThreeMfModel(ThreeMfObject(1, SquareMesh()) + ThreeMfObject(1, SquareMesh()), Item(1))),
      Catch::Contains("two objects have the id 1"));
  CHECK_THAT(ErrorOfModel(ThreeMfModel("", "")), Catch::Contains("holds no triangles"));
  CHECK_THAT(ErrorOfModel(ThreeMfModel(ThreeMfObject(1, SquareMesh()), Item(1),
                                       "requiredextensions=\"x\" xmlns:x=\"http://x.example/implicit\"")),
             Catch::Contains("needs the extension http://x.example/implicit"));
}

TEST_CASE("3MF: the archive's relationships name the model", "[import][3mf]") {
  RecordingSink sink;
  const std::string thumbnail = Relationship(
      "/Metadata/a.png", "http://schemas.openxmlformats.org/package/2006/relationships/metadata/thumbnail");
  const ZipParts parts = {
      {"Metadata/a.png", "no image"},
      {"_rels/.rels", Relationships(thumbnail + Relationship("3D\\Größe%20A.model", kModelType))},
      {"3d/größe a.MODEL", "not a model"},
      {"3D/Größe A.model", Square()}};
  CHECK(ImportText("a.3mf", Zip(parts, 0), sink) == "");
  CHECK(sink.triangles == 2);
  for (const std::string& odd : {std::string("\\"), std::string("/")}) {
    RecordingSink spelt;
    const std::string name = odd == "/" ? "/3D/3dmodel.model" : "3D\\3dmodel.model";
    CHECK(ImportText("a.3mf",
                     Zip({{name, Square()},
                          {odd == "/" ? "/_rels/.rels" : "_rels\\.rels",
                           Relationships(Relationship("/3D/3dmodel.model", kModelType))}}),
                     spelt) == "");
    CHECK(spelt.triangles == 2);
  }
  // By content, whatever the name.
  RecordingSink unnamed;
  CHECK(ImportText("a", Zip(ThreeMfParts(Square())), unnamed) == "");
  CHECK(unnamed.triangles == 2);
  CHECK_THAT(ErrorOf("a.3mf", Zip({{"a.obj", "v 0 0 0"}})),
             Catch::Contains("without a 3D model, so not a 3MF"));
  CHECK_THAT(ErrorOf("a.3mf", Zip({{"_rels/.rels", Relationships(Relationship("/b.model", kModelType))}})),
             Catch::Contains("its model, \"/b.model\", is not in the archive"));
  CHECK_THAT(ErrorOf("a.3mf", "no zip at all"), Catch::Contains("is not a complete zip archive"));
}

TEST_CASE("3MF: encrypted archives and unknown packings are refused", "[import][3mf]") {
  CHECK_THAT(ErrorOf("a.3mf", Zip(ThreeMfParts(Square()), 8, 1)), Catch::Contains("encrypted by a password"));
  CHECK_THAT(ErrorOf("a.3mf", Zip(ThreeMfParts(Square()), 14)),
             Catch::Contains("a method (14) that 3MF does not"));
  ZipParts parts = ThreeMfParts(Square());
  parts[1].second = Relationships(
      Relationship("/3D/3dmodel.model", kModelType) +
      Relationship("/Secure/keystore.xml", "http://schemas.microsoft.com/3dmanufacturing/2019/04/keystore"));
  CHECK_THAT(ErrorOf("a.3mf", Zip(parts)), Catch::Contains("encrypted parts"));
}

TEST_CASE("3MF: archives that unpack without end are refused", "[import][3mf][long]") {
  std::string model = Square();
  model.insert(model.find("<resources>"), std::string(30 << 20, ' '));
  const TemporaryFolder folder;
  const std::string path = folder.Write("a.3mf", Zip(ThreeMfParts(model)));
  RecordingSink sink;
  CHECK(ImportModel(path, sink).has_value());
  const Status limited = ImportModel(path, sink, {}, 10 << 20);
  REQUIRE(!limited);
  CHECK_THAT(limited.error().message, Catch::Contains("unpacks to more than 10.0 MiB (--unpack-limit)"));
  model.insert(model.find("<resources>"), std::string(300 << 20, ' '));
  CHECK_THAT(ErrorOfModel(model), Catch::Contains("times its own"));
  // A directory that would fill memory.
  ZipParts many = ThreeMfParts(Square());
  for (int i = 0; i < 30'000; ++i) many.emplace_back("a" + std::to_string(i), "");
  CHECK_THAT(ErrorOf("a.3mf", Zip(many)), Catch::Contains("its directory has more than 1"));
}

TEST_CASE("3MF: cut and damaged archives get one sentence", "[import][3mf]") {
  for (const int method : {0, 8}) {
    const std::string whole = Zip(ThreeMfParts(Square()), method);
    for (size_t length = 4; length < whole.size(); ++length) {
      const std::string error = ErrorOf("a.3mf", whole.substr(0, length));
      INFO(length);
      CHECK(error.starts_with("a.3mf: "));
    }
    size_t read = 0;
    for (size_t at = 0; at < 8 * whole.size(); at += 7) {
      std::string damaged = whole;
      damaged[at / 8] = static_cast<char>(damaged[at / 8] ^ (1 << (at % 8)));
      RecordingSink sink;
      const std::string error = ImportText("a.3mf", damaged, sink);
      INFO(at << ": " << error);
      if (error.empty()) {
        ++read;
        CHECK(sink.triangles == 2);
      } else {
        CHECK(error.find("a.3mf") != std::string::npos);
        CHECK(error.find('\n') == std::string::npos);
      }
    }
    CHECK(read > 0);  // times and the like may be damaged
  }
}
