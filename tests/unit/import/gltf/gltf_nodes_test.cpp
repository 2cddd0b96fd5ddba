#include <catch2/catch.hpp>
#include <cmath>
#include <glm/geometric.hpp>

#include "tests/unit/gltf_builder.h"
#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

/// One node that shows a square, changed by `change`.
template <class Change>
Builder Square(Change&& change) {
  Builder b;
  const size_t position = b.Accessor(kSquare, "VEC3", 5126);
  const size_t indices = b.Accessor(std::vector<uint8_t>{0, 1, 2, 0, 2, 3}, "SCALAR", 5121);
  b.json["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", position}}}, {"indices", indices}}}}}};
  b.json["nodes"] = {{{"mesh", 0}, {"translation", {10, 0, 0}}}};
  change(b);
  return b;
}

std::string Import(Builder b, RecordingSink& sink) { return ImportText("m.gltf", b.Text(), sink); }

std::string ErrorOfSquare(void (*change)(Builder&)) {
  RecordingSink sink;
  return Import(Square(change), sink);
}

}  // namespace

TEST_CASE("glTF: instances of a node are placed before it", "[import][gltf]") {
  RecordingSink sink;
  REQUIRE(
      Import(Square([](Builder& b) {
               const size_t at = b.Accessor(std::vector<float>{0, 0, 0, 0, 5, 0, 0, 0, 7}, "VEC3", 5126);
               const size_t scale = b.Accessor(std::vector<float>{1, 1, 1, 2, 2, 2, 1, 1, 1}, "VEC3", 5126);
               // Half a turn about z for the last, in normalised bytes.
               const size_t turn = b.Accessor(std::vector<int8_t>{0, 0, 0, 127, 0, 0, 0, 127, 0, 0, 127, 0},
                                              "VEC4", 5120, true);
               b.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
                   {"TRANSLATION", at}, {"SCALE", scale}, {"ROTATION", turn}};
               b.json["extensionsRequired"] = b.json["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
             }),
             sink)
          .empty());
  REQUIRE(sink.positions.size() == 12);
  CHECK(sink.polygons.size() == 6);
  CHECK(sink.positions[2] == glm::dvec3(11, 1, 0));
  CHECK(sink.positions[6] == glm::dvec3(12, 7, 0));
  CHECK(glm::distance(sink.positions[10], glm::dvec3(9, -1, 7)) < 1e-6);
  CHECK(sink.warnings.empty());
}

TEST_CASE("glTF: impossible instances are refused", "[import][gltf]") {
  CHECK_THAT(ErrorOfSquare([](Builder& b) {
               const size_t at = b.Accessor(std::vector<float>(6), "VEC3", 5126);
               const size_t scale = b.Accessor(std::vector<float>(9), "VEC3", 5126);
               b.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
                   {"TRANSLATION", at}, {"SCALE", scale}};
             }),
             Catch::Contains("attributes of 2 and of 3 instances"));
  CHECK_THAT(
      ErrorOfSquare([](Builder& b) {
        b.json["accessors"].push_back(
            {{"componentType", 5126}, {"count", 1u << 31}, {"type", "VEC3"}, {"bufferView", 0}});
        b.json["bufferViews"][0]["byteLength"] = uint64_t{12} << 31;
        b.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {{"TRANSLATION", 2}};
      }),
      Catch::Contains("shows meshes[0], of 4 vertices, 2147483648 times"));
}

TEST_CASE("glTF: an unknown extension that compresses or changes geometry ends the import",
          "[import][gltf]") {
  CHECK_THAT(
      ErrorOfSquare([](Builder& b) {
        b.json["extensionsUsed"] = {"KHR_coming_compression"};
        b.json["meshes"][0]["primitives"][0]["extensions"]["KHR_coming_compression"] = {{"bufferView", 0}};
        b.json["accessors"][0].erase("bufferView");
      }),
      Catch::Contains("\"KHR_coming_compression\""));
  CHECK_THAT(ErrorOfSquare([](Builder& b) {
               b.json["bufferViews"][0]["buffer"] = 1;
               b.json["bufferViews"][0]["extensions"]["EXT_coming_compression"] = {{"buffer", 0}};
             }),
             Catch::Contains("\"EXT_coming_compression\""));
  CHECK_THAT(ErrorOfSquare([](Builder& b) { b.json["extensionsUsed"] = {"KHR_gaussian_splatting"}; }),
             Catch::Contains("\"KHR_gaussian_splatting\", which changes its geometry"));
  CHECK_THAT(ErrorOfSquare([](Builder& b) { b.json["extensionsRequired"] = {"KHR_materials_sheen"}; }),
             Catch::Contains("needs the extension \"KHR_materials_sheen\""));
  // With a copy that is not compressed beside it, and extensions of no matter here, there is a warning each.
  RecordingSink sink;
  REQUIRE(Import(Square([](Builder& b) {
                   b.json["extensionsUsed"] = {"KHR_coming_compression", "KHR_materials_sheen",
                                               "KHR_materials_sheen", "KHR_materials_ior"};
                   b.json["meshes"][0]["primitives"][0]["extensions"]["KHR_coming_compression"] = {
                       {"bufferView", 0}};
                 }),
                 sink)
              .empty());
  CHECK(sink.polygons.size() == 2);
  REQUIRE(sink.warnings.size() == 2);
  CHECK_THAT(sink.warnings[0], Catch::Contains("\"KHR_coming_compression\" is not read"));
  CHECK_THAT(sink.warnings[1], Catch::Contains("\"KHR_materials_sheen\" is not read"));
}

TEST_CASE("glTF: joints move a skinned mesh, and its node does not", "[import][gltf]") {
  const auto skinned = [](Builder& b, double joint) {
    const size_t joints = b.Accessor(
        std::vector<uint8_t>{0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, static_cast<uint8_t>(joint), 1, 0, 0},
        "VEC4", 5121);
    const size_t weights =
        b.Accessor(std::vector<float>{1, 0, 0, 0, 0, 1, 0, 0, 0.5f, 0.5f, 0, 0, 1, 0, 0, 0}, "VEC4", 5126);
    const std::vector<float> inverse{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0,  1,
                                     1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -4, 1};
    const size_t bind = b.Accessor(inverse, "MAT4", 5126);
    b.json["accessors"].back()["count"] = 2;
    b.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = joints;
    b.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = weights;
    b.json["nodes"][0]["skin"] = 0;
    b.json["nodes"].push_back({{"translation", {0, 3, 0}}, {"children", {2}}});
    b.json["nodes"].push_back({{"translation", {0, 0, 6}}});
    b.json["skins"] = {{{"joints", {1, 2}}, {"inverseBindMatrices", bind}}};
  };
  RecordingSink sink;
  REQUIRE(Import(Square([&](Builder& b) { skinned(b, 0); }), sink).empty());
  CHECK(sink.positions[0] == glm::dvec3(0, 3, 0));
  CHECK(sink.positions[1] == glm::dvec3(1, 3, 2));
  CHECK(sink.positions[2] == glm::dvec3(1, 4, 1));
  RecordingSink none;
  CHECK_THAT(Import(Square([&](Builder& b) { skinned(b, 9); }), none),
             Catch::Contains("a vertex is moved by joint 9, but there are only 2"));
}

TEST_CASE("glTF: morph targets are applied by their weights; hidden nodes are left out", "[import][gltf]") {
  RecordingSink sink;
  REQUIRE(Import(Square([](Builder& b) {
                   const size_t up =
                       b.Accessor(std::vector<float>{0, 0, 2, 0, 0, 2, 0, 0, 2, 0, 0, 2}, "VEC3", 5126);
                   b.json["meshes"][0]["primitives"][0]["targets"] = {{{"POSITION", up}}};
                   b.json["meshes"][0]["weights"] = {0.5};
                   b.json["nodes"].push_back(
                       {{"mesh", 0}, {"extensions", {{"KHR_node_visibility", {{"visible", false}}}}}});
                 }),
                 sink)
              .empty());
  REQUIRE(sink.positions.size() == 4);
  CHECK(sink.positions[2] == glm::dvec3(11, 1, 1));
}

TEST_CASE("glTF: cameras and lights of nodes", "[import][gltf]") {
  RecordingSink sink;
  REQUIRE(
      Import(
          Square([](Builder& b) {
            b.json["cameras"] = {
                {{"type", "perspective"}, {"perspective", {{"yfov", 1.0}}}},
                {{"type", "orthographic"}, {"name", "side"}, {"orthographic", {{"xmag", 1}, {"ymag", 3}}}}};
            b.json["extensions"]["KHR_lights_punctual"]["lights"] = {
                {{"type", "directional"}, {"intensity", 3.14159274f}},
                {{"type", "spot"}, {"name", "lamp"}, {"spot", {{"outerConeAngle", 0.5}}}}};
            b.json["nodes"].push_back({{"camera", 0}, {"name", "front"}, {"translation", {0, 0, 5}}});
            b.json["nodes"].push_back({{"camera", 1}});
            for (int light : {0, 1})
              b.json["nodes"].push_back({{"translation", {1, 2, 3}},
                                         {"extensions", {{"KHR_lights_punctual", {{"light", light}}}}}});
          }),
          sink)
          .empty());
  REQUIRE(sink.cameras.size() == 2);
  CHECK(sink.cameras[0].name == "front");
  CHECK(sink.cameras[0].spec.eye == glm::dvec3(0, 0, 5));
  CHECK(sink.cameras[0].spec.at == glm::dvec3(0, 0, 4));
  CHECK(sink.cameras[0].spec.fov_degrees == Approx(57.2957795));
  CHECK(sink.cameras[1].name == "side");
  CHECK(sink.cameras[1].spec.ortho_height == 6);
  REQUIRE(sink.lights.size() == 2);
  CHECK(sink.lights[0].kind == LightKind::kSun);
  CHECK(sink.lights[0].direction == glm::vec3(0, 0, 1));
  CHECK(sink.lights[0].radiance.x == Approx(1));
  CHECK(sink.lights[1].name == "lamp");
  CHECK(sink.lights[1].position == glm::dvec3(1, 2, 3));
  CHECK(sink.lights[1].direction == glm::vec3(0, 0, -1));
  CHECK(sink.lights[1].cos_outer == Approx(std::cos(0.5)));
  const Light lamp = ToLight(sink.lights[1], glm::dvec3(1, 0, 0));
  CHECK(lamp.vector == glm::vec3(0, 2, 3));
}

TEST_CASE("glTF: metal, unlit and glossy materials", "[import][gltf]") {
  RecordingSink sink;
  REQUIRE(Import(Square([](Builder& b) {
                   const Json color = {0.5, 0.25, 1, 1};
                   b.json["materials"] = {
                       {{"pbrMetallicRoughness", {{"baseColorFactor", color}}}},
                       {{"pbrMetallicRoughness", {{"baseColorFactor", color}}},
                        {"extensions", {{"KHR_materials_unlit", Json::object()}}}},
                       {{"extensions",
                         {{"KHR_materials_pbrSpecularGlossiness",
                           {{"diffuseFactor", {0, 0, 0, 1}}, {"specularFactor", {1, 0.5, 0.25}}}}}}},
                       {{"pbrMetallicRoughness", {{"metallicFactor", 0}}},
                        {"extensions",
                         {{"KHR_materials_transmission", {{"transmissionFactor", 1}}},
                          {"KHR_materials_ior", {{"ior", 1.25}}},
                          {"KHR_materials_volume",
                           {{"thicknessFactor", 1},
                            {"attenuationDistance", 2},
                            {"attenuationColor", {0.5, 1, 1}}}}}}}};
                 }),
                 sink)
              .empty());
  REQUIRE(sink.materials.size() == 4);
  const Material &metal = sink.materials[0], &unlit = sink.materials[1], &glossy = sink.materials[2],
                 &glass = sink.materials[3];
  CHECK((metal.base_metalness == 1 && metal.specular_roughness == 1));
  CHECK(metal.base_color == glm::vec3(0.5f, 0.25f, 1));
  CHECK(metal.diffuse == metal.base_color);  // as rough as can be: it mirrors nothing
  CHECK(unlit.unlit);
  CHECK(unlit.emission == metal.base_color);
  CHECK(unlit.diffuse == glm::vec3(0));
  CHECK(glossy.base_metalness == Approx(1).margin(0.01));
  CHECK(glossy.specular_roughness == 0);
  CHECK(glossy.reflectance.y == Approx(0.5).margin(0.02));
  CHECK((glass.transmission_weight == 1 && glass.specular_ior == 1.25f && glass.ior == 1.25f));
  CHECK((glass.transmission_depth == 2 && glass.transmission_color == glm::vec3(0.5f, 1, 1)));
  CHECK(glass.transmittance == glm::vec3(1));
}

TEST_CASE("glTF: parts lie below their nodes' ancestors, siblings of one name apart",
          "[import][gltf][parts]") {
  RecordingSink sink;
  REQUIRE(Import(Square([](Builder& b) {
                   b.json["meshes"][0]["name"] = "square";
                   b.json["nodes"] = {{{"name", "plant"}, {"children", {1, 2, 6}}},
                                      {{"name", "valve"}, {"mesh", 0}},
                                      {{"children", {3, 4, 5}}},  // without a name
                                      {{"name", "valve"}, {"mesh", 0}},
                                      {{"name", "a/b*c\\"}, {"mesh", 0}},
                                      {{"mesh", 0}},        // has the mesh's name
                                      {{"name", "empty"}},  // no part
                                      {{"name", "pump"}, {"mesh", 0}, {"children", {8}}},
                                      {{"name", "rotor"}, {"mesh", 0}}};
                   b.json["scenes"] = {{{"nodes", {0, 7}}}};
                 }),
                 sink)
              .empty());
  CHECK(sink.parts == std::vector<std::string>{"plant", "plant/valve", "plant/valve again",
                                               "plant/a\\/b\\*c\\\\", "plant/square", "pump", "pump/rotor"});
  REQUIRE(sink.polygons.size() == 12);
  CHECK(sink.polygons[2].part == 2);
  CHECK(sink.polygons[10].part == 6);
}

TEST_CASE("glTF: extras of nodes and meshes are attributes of their parts", "[import][gltf][parts]") {
  RecordingSink sink;
  REQUIRE(Import(Square([](Builder& b) {
                   b.json["meshes"][0]["extras"] = {{"tag", "of the mesh"}, {"mass", 2}};
                   b.json["nodes"] = {
                       {{"name", "plant"}, {"extras", {{"owner", "B"}}}, {"children", {1, 2, 3}}},
                       {{"name", "valve"}, {"mesh", 0}, {"extras", {{"tag", "V-101"}}}},
                       {{"name", "pump"}, {"mesh", 0}, {"extras", "no object"}},
                       {{"name", "pipe"}, {"mesh", 0}, {"extras", nullptr}}};
                   b.json["scenes"] = {{{"nodes", {0}}}};
                 }),
                 sink)
              .empty());
  CHECK(sink.attributes ==
        std::map<uint32_t, std::string>{{0, R"({"owner":"B"})"},
                                        {1, R"({"mass":2,"tag":"V-101"})"},
                                        {2, R"({"extras":"no object","mass":2,"tag":"of the mesh"})"},
                                        {3, R"({"mass":2,"tag":"of the mesh"})"}});
}

TEST_CASE("glTF: a mesh without a name belongs to the nearest ancestor with one", "[import][gltf][parts]") {
  RecordingSink sink;
  REQUIRE(Import(Square([](Builder& b) {
                   b.json["nodes"] = {{{"name", "plant"}, {"children", {1}}}, {{"mesh", 0}}, {{"mesh", 0}}};
                   b.json["scenes"] = {{{"nodes", {0, 2}}}};
                 }),
                 sink)
              .empty());
  CHECK(sink.parts == std::vector<std::string>{"plant"});
  CHECK(sink.polygons[0].part == 0);
  CHECK(sink.polygons[2].part == kNoIndex);
}
