// Models packed by gzip and zstd, and OFF.

#include <zlib.h>
#include <zstd.h>

#include <catch2/catch.hpp>
#include <cstring>

#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

std::string Gzip(const std::string& text) {
  z_stream stream{};
  REQUIRE(deflateInit2(&stream, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY) == Z_OK);
  std::string out(text.size() + 1000, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  REQUIRE(deflate(&stream, Z_FINISH) == Z_STREAM_END);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

/// With a checksum, as the program writes it.
std::string Zstd(const std::string& text) {
  std::string out(ZSTD_compressBound(text.size()), '\0');
  ZSTD_CCtx* const context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
  const size_t size = ZSTD_compress2(context, out.data(), out.size(), text.data(), text.size());
  ZSTD_freeCCtx(context);
  REQUIRE(ZSTD_isError(size) == 0);
  out.resize(size);
  return out;
}

/// Larger than the reader's buffer, with normals that faces name before they come.
std::string LargeObj() {
  std::string text;
  for (int i = 0; i < 60000; ++i) text += "v " + std::to_string(i) + " " + std::to_string(i % 7) + " 0\n";
  text += "f 1//1 2//1 3//1\nf 60000//1 2//1 3//1\nvn 0 0 1\n";
  return text;
}

std::string BinaryStl(uint32_t facets) {
  std::string bytes(80, ' ');
  bytes.append(reinterpret_cast<const char*>(&facets), 4);
  for (uint32_t i = 0; i < facets; ++i) {
    float values[12] = {0, 0, 1, static_cast<float>(i), 0, 0, 1, 0, 0, 0, 1, 0};
    bytes.append(reinterpret_cast<const char*>(values), sizeof values);
    bytes.append(2, '\0');
  }
  return bytes;
}

}  // namespace

TEST_CASE("Packed models are read like the unpacked files", "[import][packed]") {
  const std::pair<std::string, std::string> models[] = {{"m.obj", LargeObj()}, {"m.stl", BinaryStl(1000)}};
  for (const auto& [name, content] : models) {
    RecordingSink plain;
    REQUIRE(ImportText(name, content, plain).empty());
    const size_t half = content.size() / 2;
    const std::pair<std::string, std::string> packed[] = {
        {".gz", Gzip(content)},
        {".zst", Zstd(content)},
        // Several streams one behind the other are one.
        {".gz", Gzip(content.substr(0, half)) + Gzip(content.substr(half))},
        {".zst", Zstd(content.substr(0, half)) + Zstd(content.substr(half))}};
    for (const auto& [ending, bytes] : packed) {
      INFO(name << ending);
      RecordingSink sink;
      REQUIRE(ImportText(name + ending, bytes, sink).empty());
      CHECK(sink.positions == plain.positions);
      CHECK(sink.normals == plain.normals);
      CHECK(sink.triangles == plain.triangles);
      CHECK(sink.warnings == plain.warnings);
      REQUIRE(sink.polygons.size() == plain.polygons.size());
      CHECK(sink.polygons.back().corners[0].position == plain.polygons.back().corners[0].position);
      CHECK(sink.polygons.back().corners[0].normal == plain.polygons.back().corners[0].normal);
    }
  }
}

TEST_CASE("Packed models that are damaged or cut off are refused", "[import][packed]") {
  const std::string obj = LargeObj();
  for (const auto& [name, bytes] : {std::pair{"m.obj.gz", Gzip(obj)}, {"m.obj.zst", Zstd(obj)}}) {
    INFO(name);
    for (size_t kept : {bytes.size() - 1, bytes.size() / 2, size_t{30}})
      CHECK_THAT(ErrorOf(name, bytes.substr(0, kept)), Catch::Contains("the packed file ends too early"));
    std::string bad = bytes;
    bad[bad.size() / 2] = static_cast<char>(bad[bad.size() / 2] ^ 0x55);
    CHECK_FALSE(ErrorOf(name, bad).empty());
  }
  std::string checksum = Gzip(obj);
  checksum[checksum.size() - 6] = static_cast<char>(checksum[checksum.size() - 6] ^ 1);
  CHECK_THAT(ErrorOf("m.obj.gz", checksum), Catch::Contains("damaged gzip"));
  CHECK_THAT(ErrorOf("m.glb.gz", Gzip("glTF" + std::string(100, '\0'))), Catch::Contains("not packed"));
}

TEST_CASE("OFF: vertices, faces, colours, normals, comments", "[import][off]") {
  RecordingSink sink;
  REQUIRE(
      ImportText(
          "m.off",
          "OFF # a square\n\n4 2 0\n0 0 0\n1 0 0 # a comment\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n\n3 0 1 2\n",
          sink)
          .empty());
  CHECK(sink.positions.size() == 4);
  CHECK(sink.triangles == 3);
  RecordingSink colored;
  REQUIRE(ImportText("x",
                     "CNOFF\n3 1 0\n0 0 0 0 0 1 255 0 128 255\n1 0 0 0 0 1 0 255 0 255\n0 1 0 0 0 1 0 0 255 "
                     "255\n3 0 1 2\n",
                     colored)
              .empty());
  CHECK((colored.colors[0].r == 255 && colored.colors[0].b == 55));
  CHECK(colored.normals[2] == glm::vec3(0, 0, 1));
  CHECK(colored.polygons[0].corners[1].normal == 1);
  RecordingSink counts_first;
  REQUIRE(ImportText("m.off", "3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", counts_first).empty());
  CHECK(counts_first.triangles == 1);
}

TEST_CASE("OFF: errors name the line", "[import][off]") {
  CHECK(ErrorOf("m.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n") ==
        "m.off, line 6: the face refers to vertex 3, but the file has only 3, from 0");
  CHECK(ErrorOf("m.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n") ==
        "m.off, line 5: the file ends where vertex 2 should be");
  CHECK(ErrorOf("m.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n") ==
        "m.off, line 7: the file ends where the rest of face 0 should be");
  CHECK(ErrorOf("m.off", "OFF BINARY\n") == "m.off, line 1: binary OFF is not read; convert it to ASCII");
  CHECK(ErrorOf("m.off", "OFF\nmany\n") == "m.off, line 2: the numbers of vertices and faces should be here");
  CHECK(ErrorOf("m.off", "OFF\n99999999999 1 0\n") ==
        "m.off, line 2: the numbers of vertices and faces should be here");
  CHECK(ErrorOf("m.off", "4OFF\n1 1 0\n") ==
        "m.off, line 1: OFF is read in 3 dimensions only; write it with three coordinates");
}
