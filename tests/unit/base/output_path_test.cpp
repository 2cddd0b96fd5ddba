#include "common/base/output_path.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;
using Force = OutputGuard::Force;

std::string Put(const test::TemporaryFolder& folder, const std::string& name, const std::string& text) {
  std::ofstream(folder.file(name), std::ios::binary) << text;
  return folder.file(name);
}

std::string TextOf(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

/// The sentence, or "" when the output is taken.
std::string Refusal(OutputGuard& guard, const std::string& path, const OutputKind& kind = kPngOutput) {
  const auto place = guard.Take(path, kind);
  if (place) return "";
  CHECK(place.error().exit_status() == 2);
  return place.error().message;
}

}  // namespace

TEST_CASE("Outputs follow links and keep them", "[outputs]") {
  const test::TemporaryFolder folder;
  fs::create_directory(folder.file("there"));
  fs::create_symlink("there/real", folder.file("b"));
  fs::create_symlink("b", folder.file("a"));
  CHECK(PlaceOf(folder.file("a"))->path == folder.file("there/real"));
  for (const char* text : {"first", "second"}) {
    REQUIRE(WriteFileAtomically(folder.file("a"), AsBytes(std::string(text))));
    CHECK(fs::is_symlink(folder.file("a")));
    CHECK(fs::is_symlink(folder.file("b")));
    CHECK(TextOf(folder.file("there/real")) == text);
  }
  fs::create_symlink("loop", folder.file("loop"));
  CHECK_THAT(PlaceOf(folder.file("loop")).error().message, Contains("circle"));
  CHECK_THAT(PlaceOf(folder.file("there")).error().message, Contains("is a folder"));
  CHECK_FALSE(PlaceOf("").has_value());
  CHECK_FALSE(WriteFileAtomically(folder.file("there"), {}).has_value());
}

TEST_CASE("A fifo is written to and kept", "[outputs]") {
  const test::TemporaryFolder folder;
  const std::string fifo = folder.file("fifo");
  REQUIRE(::mkfifo(fifo.c_str(), 0600) == 0);
  CHECK(PlaceOf(fifo)->stream);
  CHECK_THAT(WriteFileAtomically(fifo, AsBytes(std::string("x"))).error().message,
             Contains("no program reads"));
  const int reader = ::open(fifo.c_str(), O_RDONLY | O_NONBLOCK);
  REQUIRE(reader >= 0);
  {
    auto file = OutputFile::Create(fifo);
    REQUIRE(file);
    REQUIRE(file->Write("hello", 5));
    CHECK_FALSE(file->WriteAt(0, AsBytes(std::string("j"))).has_value());
    REQUIRE(file->Commit());
  }
  char bytes[8] = {};
  CHECK(::read(reader, bytes, sizeof bytes) == 5);
  CHECK(std::string(bytes) == "hello");
  ::close(reader);
  CHECK(fs::is_fifo(fifo));
  CHECK(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()) == 1);
}

TEST_CASE("An output that is also an input is refused, however it is spelt", "[outputs]") {
  const test::TemporaryFolder folder;
  const std::string model = Put(folder, "model.png", "\x89PNG\r\n\x1A\n");
  fs::create_hard_link(model, folder.file("hard.png"));
  fs::create_symlink("model.png", folder.file("soft.png"));
  for (const Force force : {Force::kNo, Force::kYes}) {
    OutputGuard guard(force);
    guard.AddInput(model);
    guard.AddInput(folder.file("is not there"));
    guard.AddInput("-");
    for (const std::string& name : {std::string("model.png"), std::string("./model.png"),
                                    "../" + fs::path(folder.path()).filename().string() + "/model.png",
                                    std::string("hard.png"), std::string("soft.png")})
      CHECK_THAT(Refusal(guard, folder.file(name)), Contains("is an input of this run"));
    CHECK(Refusal(guard, folder.file("new.png")) == "");
    CHECK_THAT(Refusal(guard, folder.file("./new.png")), Contains("is written twice"));
  }
}

TEST_CASE("A file of another kind is replaced by force only", "[outputs]") {
  const test::TemporaryFolder folder;
  const std::string notes = Put(folder, "notes", "mine"), empty = Put(folder, "empty", ""),
                    png = Put(folder, "png", "\x89PNG\r\n\x1A\n...");
  const std::string gltf = Put(folder, "gltf", "{\"asset\": {\"version\": \"2.0\"}}"),
                    stats = Put(folder, "stats", "{\n  \"scene_id\": \"1\"}");
  OutputGuard guard(Force::kNo);
  CHECK_THAT(Refusal(guard, notes), Contains("is not a PNG image") && Contains("--force"));
  CHECK_THAT(Refusal(guard, gltf, kStatisticsOutput), Contains("is not a statistics file of Quarry"));
  OutputGuard of_bench(Force::kNo);
  CHECK_THAT(Refusal(of_bench, gltf, kFiguresOutput), Contains("is not a JSON file of figures"));
  CHECK(Refusal(guard, empty) == "");
  CHECK(Refusal(guard, png) == "");
  CHECK(Refusal(guard, stats, kStatisticsOutput) == "");
  OutputGuard forced(Force::kYes), without(Force::kNotOffered);
  CHECK(Refusal(forced, notes) == "");
  CHECK_THAT(Refusal(without, notes), Contains("remove it first") && !Contains("--force"));
  CHECK(TextOf(notes) == "mine");
  CHECK_THAT(OutputGuard::TakeFolder(notes).error().message, Contains("is not a folder"));
  CHECK(OutputGuard::TakeFolder(folder.path()).has_value());
  CHECK(OutputGuard::TakeFolder(folder.file("new")).has_value());
}

TEST_CASE("An output that has been read is not replaced; a file that only has its inode may be",
          "[outputs]") {
  const test::TemporaryFolder folder;
  OutputGuard guard(Force::kNo);
  const std::string read = Put(folder, "read", "");
  REQUIRE(Refusal(guard, read) == "");
  CHECK(CheckNotRead(read));
  NoteRead(read);
  CHECK_THAT(CheckNotRead(read).error().message, Contains("is an input of this run"));
  // Most file systems give a deleted file's inode to the next one.
  for (int i = 0; i < 8; ++i) {
    const std::string name = "taken-" + std::to_string(i);
    REQUIRE(Refusal(guard, Put(folder, name, "")) == "");
    fs::remove(folder.file(name));
    ::usleep(20000);  // births are as fine as the kernel's clock ticks
    Put(folder, name, "another file");
    NoteRead(folder.file(name));
    CHECK(CheckNotRead(folder.file(name)));
  }
}

TEST_CASE("Only regular files are opened for reading", "[outputs]") {
  const test::TemporaryFolder folder;
  REQUIRE(::mkfifo(folder.file("fifo").c_str(), 0600) == 0);
  CHECK_THAT(InputFile::Open(folder.file("fifo")).error().message, Contains("is not a regular file"));
  CHECK_THAT(InputFile::Open("/dev/null").error().message, Contains("is not a regular file"));
}

}  // namespace quarry
