#include "common/base/progress.h"

#include <catch2/catch.hpp>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

/// The part of the work that the progress file states, 0 to 1.
double DoneOf(const std::string& file) {
  std::ifstream in(file);
  return nlohmann::json::parse(in)["done"].get<double>();
}

}  // namespace

TEST_CASE("Stages make up one whole, whose part never falls", "[base]") {
  const test::TemporaryFolder folder;
  const std::string file = folder.file("progress");
  ::setenv("QUARRY_PROGRESS_FILE", file.c_str(), 1);
  const auto after = [&](auto&& use) {
    std::filesystem::remove(file);
    Progress progress(true);
    use(progress);
    return DoneOf(file);
  };
  CHECK(after([](Progress& p) { p.Begin("alone"), p.Update(1, 4); }) == Approx(0.25));
  CHECK(after([](Progress& p) {
          p.BeginStage(0.2), p.BeginStage(0.6);
          p.Begin("second"), p.Update(1, 4);
        }) == Approx(0.35));
  // The file has an update after a quarter of a second.
  CHECK(after([](Progress& p) {
          p.BeginStage(0.5);
          p.Begin("first"), p.Update(9, 10);
          std::this_thread::sleep_for(std::chrono::milliseconds(300));
          p.Begin("again"), p.Update(1, 10);
        }) == Approx(0.45));
  ::unsetenv("QUARRY_PROGRESS_FILE");
}

}  // namespace quarry
