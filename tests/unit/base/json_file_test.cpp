#include "common/base/json_file.h"

#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using Catch::Matchers::Contains;
using nlohmann::json;

std::string ErrorOf(const std::string& text, const JsonLimits& limits = {}) {
  const auto parsed = ParseJson<json>(text, "f.json", limits);
  if (parsed) return "";
  CHECK_THAT(parsed.error().message, Catch::StartsWith("f.json: "));
  return parsed.error().message;
}

}  // namespace

TEST_CASE("Json values are read unchanged", "[json]") {
  const std::string text =
      R"({"a": [1, -2, 2.5, true, null, "x\u00e9", {"b": []}], "c": {"d": 18446744073709551615}})";
  const auto parsed = ParseJson<json>(text, "f.json");
  REQUIRE(parsed);
  CHECK(*parsed == json::parse(text));
  CHECK(ParseJson<json>("7", "f")->get<int>() == 7);
  CHECK(ParseJson<nlohmann::ordered_json>(R"({"z": 1, "a": 2})", "f")->dump() == R"({"z":1,"a":2})");
}

TEST_CASE("Invalid Json is refused with the byte", "[json]") {
  CHECK_THAT(ErrorOf(""), Contains("byte 1"));
  CHECK_THAT(ErrorOf("{\"a\": [1, 2"), Contains("byte 12") && Contains("in a[2]"));
  CHECK_THAT(ErrorOf("{\"a\": 1} x"), Contains("byte 10"));
  CHECK_THAT(ErrorOf("\"\xff\""), Contains("byte"));
}

TEST_CASE("A number out of range names its key", "[json]") {
  CHECK_THAT(ErrorOf(R"({"frames": [{}, {"eye": [0, 1e999, 0]}]})"),
             Contains("frames[1].eye[1] is the number 1e999"));
  CHECK_THAT(ErrorOf("-1e999"), Contains("out of range"));
  const auto single = ParseJson<FloatJson>(R"({"ior": 1e99})", "m.json");
  REQUIRE_FALSE(single);
  CHECK_THAT(single.error().message, Contains("ior is the number 1e99"));
}

TEST_CASE("Json beyond its limits is refused", "[json]") {
  for (const char* open : {"[", "{\"a\":"}) {
    std::string deep;
    for (int i = 0; i < 400000; ++i) deep += open;
    CHECK_THAT(ErrorOf(deep), Contains("deeper than 64"));
  }
  CHECK(ErrorOf("[[[[7]]]]", {100, 4, 100}) == "");
  CHECK_THAT(ErrorOf("[[[[[7]]]]]", {100, 4, 100}), Contains("deeper than 4"));
  CHECK_THAT(ErrorOf("[1,2,3]", {100, 4, 3}), Contains("more than 3 values"));
  CHECK_THAT(ErrorOf("[1,2,3]", {6, 4, 30}), Contains("6 bytes"));
  CHECK_THAT(ErrorOf(R"({"a": 1, "b": 2})", {100, 4, 30, 1}), Contains("more than 1 members"));
}

TEST_CASE("Values of the wrong type are named by file and key", "[json]") {
  const std::string file = "f.json";
  const json root = json::parse(R"({"list": [{"eye": [1, 2, 3], "name": "x", "two": [1, "y"]}], "n": 5})");
  const JsonValue whole(root, file);
  const auto item = (*whole.Member("list")->List())[0];
  double eye[3];
  REQUIRE(item.Member("eye")->Numbers(eye, 0, 10));
  CHECK(eye[2] == 3);
  CHECK(*item.Member("name")->Text() == "x");
  CHECK(*whole.Member("n")->Number() == 5);
  CHECK_FALSE(whole.Optional("m")->has_value());
  CHECK(item.Member("at").error().message == "f.json: list[0]: 'at' is missing");
  CHECK_THAT(item.Member("eye")->Numbers(eye, 0, 2).error().message,
             Contains("f.json: list[0].eye: must be three numbers"));
  CHECK_THAT(item.Member("two")->Numbers(std::span(eye, 2), 0, 2).error().message, Contains("list[0].two"));
  CHECK_THAT(item.Member("name")->Number().error().message, Contains("list[0].name: must be a number"));
  CHECK_THAT(item.Member("eye")->Text().error().message, Contains("list[0].eye: must be a text"));
  CHECK_THAT(whole.Member("n")->List().error().message, Contains("n: must be a list"));
  CHECK_THAT(whole.Member("n")->Member("x").error().message, Contains("n: must be an object"));
}

TEST_CASE("Json is read from regular files only", "[json]") {
  const test::TemporaryFolder folder;
  std::ofstream(folder.file("a.json")) << "[1]";
  CHECK(ReadJsonFile<json>(folder.file("a.json"))->size() == 1);
  REQUIRE(::mkfifo(folder.file("fifo").c_str(), 0600) == 0);
  CHECK_THAT(ReadJsonFile<json>(folder.file("fifo")).error().message, Contains("is not a regular file"));
  CHECK_THAT(ReadJsonFile<json>(folder.path()).error().message, Contains("is a folder"));
}

}  // namespace quarry
