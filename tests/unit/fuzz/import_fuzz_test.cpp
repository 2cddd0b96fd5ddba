// A fixed number of mutations of small valid files, the same on every run, through the fuzzer's entry.

#include "tests/fuzz/import_fuzz.h"

#include <catch2/catch.hpp>
#include <random>
#include <string>
#include <vector>

#include "tests/unit/three_mf_builder.h"

namespace {

using namespace quarry;

std::string PlyHeader(const std::string& format, const std::string& more) {
  return "ply\nformat " + format +
         " 1.0\ncomment c\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n" + more +
         "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
}

/// Seeds; the first byte is the extension's choice.
std::vector<std::string> Seeds() {
  const std::string rows(36, '\0');
  const std::string little("\3\0\0\0\0\1\0\0\0\2\0\0\0", 13), big("\3\0\0\0\0\0\0\0\1\0\0\0\2", 13);
  const std::string obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n";
  const std::string facet =
      "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
  std::string binary_stl(84 + 100, '\0');
  binary_stl[80] = 2;
  const std::string three_mf = ThreeMfModel(
      "<basematerials id=\"7\"><base name=\"a\" displaycolor=\"#ff0000\"/></basematerials>"
      "<m:colorgroup id=\"8\"><m:color color=\"#00ff00\"/><m:color color=\"#0000ffff\"/></m:colorgroup>" +
          ThreeMfObject(1, SquareMesh("pid=\"8\" p1=\"0\" p2=\"1\"", "p1=\"0\""), "pid=\"7\" pindex=\"0\"") +
          ThreeMfObject(2, Components(Component(1) + Component(1, Moved("1 2 3")))),
      Item(1) + Item(2, Moved("4 5 6")));
  return {
      '\0' + PlyHeader("ascii", "") + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 2 1 0\n",
      '\0' + PlyHeader("ascii", "property uchar red\nproperty list int float w\n") +
          "0 0 0 1 0\n1 0 0 2 1 5\n0 1 0 3 0\n3 0 1 2\n3 2 1 0\n",
      '\0' + PlyHeader("binary_little_endian", "") + rows + little + little,
      '\0' + PlyHeader("binary_big_endian", "") + rows + big + big,
      '\0' + PlyHeader("binary_little_endian", "property list uchar short w\n") + std::string(39, '\0') +
          little + little,
      std::string(1, '\0') +
          "ply\nformat ascii 1.0\nelement vertex 3\nproperty int x\nproperty int y\nproperty int z\n"
          "element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0 1 0 0 0 1 0\n5 0 1 2 "
          "-1 0\n",
      '\1' + obj + "f 1 2 3\n",
      '\1' + obj + "g a\nusemtl m\nf 1/1/1 2/1/1 3/1/1\nf -1 -2 -3\n",
      '\1' + obj + "o b\ns 1\nf 1//1 \\\n2//1 3//1\nl 1 2\n",
      "\2solid a\n" + facet + "endsolid\nsolid b\n" + facet + "endsolid\n",
      '\2' + binary_stl,
      '\3' + obj + "f 1 2 3 1 2 3\n",
      '\7' + Zip(ThreeMfParts(three_mf)),
      '\10' + three_mf,
  };
}

std::string Mutate(std::string text, const std::string& other, std::mt19937& random) {
  const auto below = [&](size_t n) { return n == 0 ? 0 : random() % n; };
  for (size_t rounds = 1 + below(4); rounds > 0; --rounds) {
    const size_t at = 1 + below(text.size() - 1);
    switch (below(5)) {
      case 0:
        text.resize(at);
        break;
      case 1:
        text[at % text.size()] ^= static_cast<char>(1u << below(8));
        break;
      case 2:
        text[at % text.size()] = static_cast<char>(random());
        break;
      case 3:
        text.insert(at, other.substr(below(other.size()), below(40)));
        break;
      case 4:
        text.insert(at, std::vector<std::string>{"999999999999999999999", "-1", "4294967295",
                                                 "\xFF\xFF\xFF\xFF", "\n", "1e999"}[below(6)]);
        break;
    }
    if (text.size() < 2) break;
  }
  return text;
}

int Import(const std::string& text) {
  return LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(text.data()), text.size());
}

}  // namespace

TEST_CASE("Importers survive broken files", "[import][fuzz]") {
  const std::vector<std::string> seeds = Seeds();
  std::mt19937 random(20011);  // the same files on every run
  size_t runs = 0;
  for (const std::string& seed : seeds) {
    for (size_t length = 1; length < seed.size(); ++length)
      runs += 1 + static_cast<size_t>(Import(seed.substr(0, length)));
    for (int i = 0; i < 400; ++i)
      runs += 1 + static_cast<size_t>(Import(Mutate(seed, seeds[random() % seeds.size()], random)));
  }
  CHECK(runs > seeds.size() * 400);
}
