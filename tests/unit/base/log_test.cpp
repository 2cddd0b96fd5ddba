#include "common/base/log.h"

#include <catch2/catch.hpp>
#include <string>

#include "common/base/output_path.h"

namespace quarry {
namespace {

TEST_CASE("Text of strangers is shown without control codes", "[log]") {
  CHECK(Printable("plain, Süd, プラント, \U0001F600") == "plain, Süd, プラント, \U0001F600");
  CHECK(Printable("a\x1b[31mred") == "a\\x1b[31mred");
  CHECK(Printable("tab\tand\nline") == "tab\tand\nline");
  CHECK(PrintableName("tab\tand\nline\r") == "tab\tand\\x0aline\\x0d");
  CHECK(Printable(std::string("a\0b\x7f", 4)) == "a\\x00b\\x7f");
  CHECK(Printable("\xc2\x9b"
                  "31m") == "\\x9b31m");
  CHECK(Printable("left\xe2\x80\xaegnp.obj") == "left\\u{202e}gnp.obj");
  CHECK(Printable("isolate\xe2\x81\xa6") == "isolate\\u{2066}");
  CHECK(Printable("") == "");
}

TEST_CASE("Bytes that are not UTF-8 are shown as bytes", "[log]") {
  CHECK(Printable("\xff\xfe") == "\\xff\\xfe");
  CHECK(Printable("latin \xfc") == "latin \\xfc");
  CHECK(Printable("cut \xe3\x83") == "cut \\xe3\\x83");
  CHECK(Printable("long form \xc0\xaf") == "long form \\xc0\\xaf");
  CHECK(Printable("\xe0\x80\xaf") == "\\xe0\\x80\\xaf");
  CHECK(Printable("surrogate \xed\xa0\x80") == "surrogate \\xed\\xa0\\x80");
  CHECK(Printable("beyond \xf4\x90\x80\x80") == "beyond \\xf4\\x90\\x80\\x80");
}

TEST_CASE("Printable text stays as it is when it is printed again", "[log]") {
  for (const std::string text : {"a\x1b[31m", "\xff", "left\xe2\x80\xae"})
    CHECK(Printable(Printable(text)) == Printable(text));
}

TEST_CASE("Temporary names beside an output are no longer than the file system allows", "[output_path]") {
  CHECK(BesidePath("a/b.png", ".tmp-1") == "a/b.png.tmp-1");
  const std::string longest(251, 'a');
  const std::string beside = BesidePath("/tmp/" + longest + ".png", ".tmp-123");
  CHECK(beside.size() <= 5 + 255);
  CHECK(beside.starts_with("/tmp/aaa"));
  CHECK(beside.ends_with(".tmp-123"));
  CHECK(beside == BesidePath("/tmp/" + longest + ".png", ".tmp-123"));
  CHECK(beside != BesidePath("/tmp/" + longest.substr(1) + "b.png", ".tmp-123"));
  std::string umlauts;
  for (int i = 0; i < 126; ++i) umlauts += "ü";
  const std::string cut = BesidePath("/tmp/x" + umlauts, ".tmp-1");
  CHECK(Printable(cut) == cut);  // no letter is cut
}

}  // namespace
}  // namespace quarry
