#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/api/quarry.h"
#include "tests/support/rendering/row_scene.h"

// The calls of quarry.h: arguments, errors, lives of scenes. Hits are compared in tests/reference/rays.

namespace quarry::test {
namespace {

/// Closes a scene at the end.
struct Opened {
  explicit Opened(const std::string& path, uint64_t cache = 1 << 20, uint32_t threads = 2) {
    quarry_options options = QUARRY_OPTIONS_INIT;
    options.cache_bytes = cache;
    options.threads = threads;
    const quarry_status status = quarry_open(path.c_str(), &options, &scene);
    INFO(quarry_error());
    REQUIRE(status == QUARRY_OK);
  }
  ~Opened() { quarry_close(scene); }
  quarry_scene* scene = nullptr;
};

/// Rays toward the wall at y = 15, as six numbers each.
struct Rays {
  explicit Rays(size_t count) {
    for (size_t i = 0; i < count; ++i) {
      const double x = static_cast<double>(i % 31) - 15;
      for (const double number : {x, 0.0, 0.25, 0.0, 2.0, 0.0}) numbers.push_back(number);
    }
    given.count = count;
    given.origins = numbers.data();
    given.directions = numbers.data() + 3;
    given.stride = 6 * sizeof(double);
  }
  std::vector<double> numbers;
  quarry_rays given = QUARRY_RAYS_INIT;
};

bool Says(const char* text) {
  UNSCOPED_INFO(quarry_error());
  return std::strstr(quarry_error(), text) != nullptr;
}

}  // namespace

TEST_CASE("quarry.h: a ray's t counts lengths of its direction", "[api]") {
  const Row row;
  const Opened open(row.folder.file("s"));
  const Rays rays(100);
  std::vector<double> t(100);
  std::vector<uint32_t> triangle(100);
  quarry_hits hits = QUARRY_HITS_INIT;
  hits.t = t.data();
  hits.triangle = triangle.data();
  REQUIRE(quarry_nearest(open.scene, &rays.given, &hits) == QUARRY_OK);
  for (size_t i = 0; i < t.size(); ++i) CHECK(t[i] == 7.5);
  CHECK((triangle[0] == 4 || triangle[0] == 5));
}

TEST_CASE("quarry.h: floats, strides and ends", "[api]") {
  const Row row;
  const Opened open(row.folder.file("s"));
  // Rays of 7 floats: origin, direction, and what is none of the call's; from the last to the first.
  const std::vector<float> numbers{1, 0, 1, 0, 1, 0, 99, 2, 0, 1, 0, 3, 0, 99};
  const std::vector<float> near{0, 6}, far{14, 100};
  quarry_rays rays = QUARRY_RAYS_INIT;
  rays.type = QUARRY_FLOAT32;
  rays.count = 2;
  rays.origins = &numbers[7];
  rays.directions = &numbers[10];
  rays.stride = -7 * static_cast<ptrdiff_t>(sizeof(float));
  std::array<double, 2> t{};
  quarry_hits hits = QUARRY_HITS_INIT;
  hits.t = t.data();
  REQUIRE(quarry_nearest(open.scene, &rays, &hits) == QUARRY_OK);
  CHECK(t[0] == 5);
  CHECK(t[1] == 15);
  rays.tnear = near.data();
  rays.tfar = far.data();
  REQUIRE(quarry_nearest(open.scene, &rays, &hits) == QUARRY_OK);
  CHECK(t[0] == 5);
  CHECK(t[1] == 15);
  const std::vector<float> behind{6, 0}, before{100, 14};
  rays.tnear = behind.data();
  rays.tfar = before.data();
  std::array<uint8_t, 2> any{7, 7};
  REQUIRE(quarry_any(open.scene, &rays, any.data()) == QUARRY_OK);
  CHECK(any == std::array<uint8_t, 2>{0, 0});
}

TEST_CASE("quarry.h: bad rays are named by array and index", "[api]") {
  const Row row;
  const Opened open(row.folder.file("s"));
  Rays rays(5000);
  std::vector<uint8_t> any(5000);
  const auto fails = [&](const char* text) {
    return quarry_any(open.scene, &rays.given, any.data()) == QUARRY_ARGUMENT && Says(text);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  const auto with = [&](size_t at, double value, const char* text) {
    const double before = std::exchange(rays.numbers[at], value);
    const bool named = fails(text);
    rays.numbers[at] = before;
    return named;
  };
  CHECK(with(6 * 4321 + 1, nan, "rays->origins[4321]"));
  CHECK(with(6 * 4321 + 1, inf, "rays->origins[4321]"));
  CHECK(with(6 * 4999 + 2, 1e31, "rays->origins[4999] lies farther"));
  CHECK(with(6 * 17 + 3, nan, "rays->directions[17]"));
  CHECK(with(6 * 17 + 4, 0, "rays->directions[17] is 0"));
  CHECK(with(6 * 17 + 4, 1e-200, "rays->directions[17] is too short"));
  CHECK(with(6 * 17 + 4, 1e200, "rays->directions[17] is too long"));
  std::vector<double> near(5000, 0), far(5000, 1);
  rays.given.tnear = near.data();
  rays.given.tfar = far.data();
  near[3] = -1;
  CHECK(fails("rays->tnear[3] is -1"));
  near[3] = nan;
  CHECK(fails("rays->tnear[3]"));
  near[3] = 1;
  CHECK(fails("rays->tfar[3] is 1, not beyond"));
  near[3] = 0;
  far[4] = nan;
  CHECK(fails("rays->tfar[4]"));
  far[4] = 1;
  CHECK(quarry_any(open.scene, &rays.given, any.data()) == QUARRY_OK);
}

TEST_CASE("quarry.h: missing arrays, unknown values and other sizes are refused", "[api]") {
  const Row row;
  const Opened open(row.folder.file("s"));
  Rays rays(3);
  std::array<uint8_t, 3> any{};
  quarry_hits hits = QUARRY_HITS_INIT;
  const auto refused = [&](quarry_status status, const char* text) {
    return status == QUARRY_ARGUMENT && Says(text);
  };
  CHECK(refused(quarry_any(open.scene, nullptr, any.data()), "rays is NULL"));
  CHECK(refused(quarry_any(open.scene, &rays.given, nullptr), "hit is NULL"));
  CHECK(refused(quarry_count(open.scene, &rays.given, nullptr), "counts is NULL"));
  CHECK(refused(quarry_nearest(open.scene, &rays.given, nullptr), "hits is NULL"));
  CHECK(refused(quarry_all(open.scene, &rays.given, nullptr, &hits), "splits is NULL"));
  CHECK(refused(quarry_describe(open.scene, nullptr), "description is NULL"));
  hits.size = 3;
  CHECK(refused(quarry_nearest(open.scene, &rays.given, &hits), "hits->size is 3"));
  quarry_rays other = rays.given;
  other.size = 8;
  CHECK(refused(quarry_any(open.scene, &other, any.data()), "rays->size is 8"));
  other = rays.given;
  other.flags = 6;
  CHECK(refused(quarry_any(open.scene, &other, any.data()), "rays->flags"));
  other = rays.given;
  other.type = static_cast<quarry_number>(5);
  CHECK(refused(quarry_any(open.scene, &other, any.data()), "rays->type is 5"));
  other = rays.given;
  other.origins = nullptr;
  CHECK(refused(quarry_any(open.scene, &other, any.data()), "rays->origins is NULL"));
  other = rays.given;
  other.count = SIZE_MAX / 2;
  CHECK(refused(quarry_any(open.scene, &other, any.data()), "rays->count is"));
  other.count = 0;
  other.origins = other.directions = nullptr;
  CHECK(quarry_any(open.scene, &other, nullptr) == QUARRY_OK);
  quarry_scene* scene = open.scene;
  CHECK(refused(quarry_open(nullptr, nullptr, &scene), "place is NULL"));
  CHECK(scene == nullptr);
  CHECK(refused(quarry_open("x", nullptr, nullptr), "scene is NULL"));
  quarry_options options = QUARRY_OPTIONS_INIT;
  options.cache_bytes = 1;
  CHECK(refused(quarry_open(row.folder.file("s").c_str(), &options, &scene), "options->cache_bytes is 1"));
  options.cache_bytes = 0;
  options.threads = 100'000;
  CHECK(refused(quarry_open(row.folder.file("s").c_str(), &options, &scene), "options->threads is 100000"));
  double eye[3] = {0, 0, 0}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1}, out[6];
  CHECK(quarry_pinhole(eye, at, up, 45, QUARRY_VERTICAL, 1, 1, out) == QUARRY_ARGUMENT);
}

TEST_CASE("quarry.h: splits that are not the rays' are refused, and nothing is written beyond them",
          "[api]") {
  const Row row;
  const Opened open(row.folder.file("s"));
  const Rays rays(3000);
  std::vector<uint32_t> counts(3000);
  REQUIRE(quarry_count(open.scene, &rays.given, counts.data()) == QUARRY_OK);
  std::vector<uint64_t> splits{0};
  for (const uint32_t count : counts) splits.push_back(splits.back() + count);
  std::vector<double> t(splits.back() + 1, -1);
  quarry_hits hits = QUARRY_HITS_INIT;
  hits.t = t.data();
  REQUIRE(quarry_all(open.scene, &rays.given, splits.data(), &hits) == QUARRY_OK);
  CHECK(t.back() == -1);
  CHECK(t[0] == 7.5);
  auto fewer = splits;
  for (size_t i = 2000; i < fewer.size(); ++i) --fewer[i];
  CHECK(quarry_all(open.scene, &rays.given, fewer.data(), &hits) == QUARRY_ARGUMENT);
  CHECK(Says("splits[2000] - splits[1999] is 0"));
  CHECK(t.back() == -1);
  fewer = splits;
  fewer[5] = 1;
  CHECK(quarry_all(open.scene, &rays.given, fewer.data(), &hits) == QUARRY_ARGUMENT);
  CHECK(Says("splits[5] is less than splits[4]"));
}

TEST_CASE("quarry.h: a closed scene is an error, and so is one that never was", "[api]") {
  const Row row;
  quarry_scene* scene = nullptr;
  REQUIRE(quarry_open(row.folder.file("s").c_str(), nullptr, &scene) == QUARRY_OK);
  REQUIRE(quarry_close(scene) == QUARRY_OK);
  CHECK(quarry_close(scene) == QUARRY_ARGUMENT);
  CHECK(Says("not open"));
  quarry_description description = QUARRY_DESCRIPTION_INIT;
  CHECK(quarry_describe(scene, &description) == QUARRY_ARGUMENT);
  CHECK(quarry_describe(nullptr, &description) == QUARRY_ARGUMENT);
  CHECK(quarry_close(nullptr) == QUARRY_OK);
  quarry_scene* next = nullptr;
  REQUIRE(quarry_open(row.folder.file("s").c_str(), nullptr, &next) == QUARRY_OK);
  CHECK(next != scene);
  CHECK(quarry_close(next) == QUARRY_OK);
}

TEST_CASE("quarry.h: names are cut between letters, and their length is told", "[api]") {
  const Row row;
  const Opened open(row.folder.file("s"));
  char name[8];
  size_t length = 99;
  quarry_description d = QUARRY_DESCRIPTION_INIT;
  REQUIRE(quarry_describe(open.scene, &d) == QUARRY_OK);
  CHECK(quarry_part_name(open.scene, static_cast<uint32_t>(d.parts), name, sizeof name, &length) ==
        QUARRY_ARGUMENT);
  CHECK(quarry_material_name(open.scene, d.materials, name, sizeof name, &length) == QUARRY_ARGUMENT);
  REQUIRE(d.materials > 0);
  REQUIRE(quarry_material_name(open.scene, 0, nullptr, 0, &length) == QUARRY_OK);
  CHECK(quarry_material_name(open.scene, 0, nullptr, 5, &length) == QUARRY_ARGUMENT);
  REQUIRE(quarry_material_name(open.scene, 0, name, sizeof name, nullptr) == QUARRY_OK);
  CHECK(std::strlen(name) == std::min(length, sizeof name - 1));
}

TEST_CASE("quarry.h: a damaged block is an error of each call that needs it, and of no other", "[api]") {
  const Row row;
  const std::string path = row.folder.file("s");
  const uint64_t at = row.scene->catalog().voxels[2].blocks[0].offset;
  {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(static_cast<std::streamoff>(at));
    const char byte = static_cast<char>(file.get() ^ 0x40);
    file.seekp(static_cast<std::streamoff>(at));
    file.put(byte);
  }
  const Opened open(path);
  Rays rays(10);
  std::array<uint8_t, 10> any{};
  for (int again = 0; again < 3; ++again) {
    CHECK(quarry_any(open.scene, &rays.given, any.data()) == QUARRY_DATA);
    CHECK(Says("damaged"));
    CHECK(Says(std::to_string(at).c_str()));
  }
  for (size_t i = 0; i < 10; ++i) rays.numbers[6 * i + 4] = -1;  // away from the wall
  CHECK(quarry_any(open.scene, &rays.given, any.data()) == QUARRY_OK);
}

TEST_CASE("quarry.h: calls are cancelled by their tag, and by closing", "[api]") {
  const Row row;
  for (const bool closes : {false, true}) {
    quarry_scene* scene = nullptr;
    REQUIRE(quarry_open(row.folder.file("s").c_str(), nullptr, &scene) == QUARRY_OK);
    Rays rays(2'000'000), few(10);
    rays.given.tag = 7;
    std::vector<uint8_t> any(rays.given.count);
    std::atomic<bool> over{false};
    quarry_status status = QUARRY_OK;
    std::thread caller([&] {
      while (status == QUARRY_OK) status = quarry_any(scene, &rays.given, any.data());
      over = true;
    });
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    if (closes) {
      CHECK(quarry_close(scene) == QUARRY_OK);
    } else {
      CHECK(quarry_cancel(scene, 8) == QUARRY_OK);  // another's
      CHECK(quarry_any(scene, &few.given, any.data()) == QUARRY_OK);
      while (!over) CHECK(quarry_cancel(scene, 7) == QUARRY_OK);
      CHECK(quarry_any(scene, &few.given, any.data()) == QUARRY_OK);
    }
    caller.join();
    // A call that begins after the end of the scene finds none.
    CHECK((status == QUARRY_CANCELLED || (closes && status == QUARRY_ARGUMENT)));
    if (!closes) CHECK(quarry_close(scene) == QUARRY_OK);
  }
}

TEST_CASE("quarry.h: open, ask, cancel and close, a thousand times", "[api][long]") {
  const Row row;
  const Rays rays(3000);
  for (int i = 0; i < 1000; ++i) {
    quarry_scene* scene = nullptr;
    quarry_options options = QUARRY_OPTIONS_INIT;
    options.threads = 1 + static_cast<uint32_t>(i % 3);
    if (quarry_open(row.folder.file("s").c_str(), &options, &scene) != QUARRY_OK) FAIL(quarry_error());
    std::vector<uint8_t> any(3000);
    std::thread caller([&] { quarry_any(scene, &rays.given, any.data()); });
    if (i % 3 == 1) quarry_cancel(scene, QUARRY_EVERY_TAG);
    if (i % 3 == 2) caller.join();
    if (quarry_close(scene) != QUARRY_OK) FAIL(quarry_error());
    if (caller.joinable()) caller.join();
  }
}

TEST_CASE("quarry.h: a forked child is told so, and may open a scene of its own", "[api]") {
  const Row row;
  const Opened open(row.folder.file("s"));
  const Rays rays(2000);
  std::vector<uint8_t> any(2000);
  REQUIRE(quarry_any(open.scene, &rays.given, any.data()) == QUARRY_OK);
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {  // reports by its status
    int failed = 0;
    if (quarry_any(open.scene, &rays.given, any.data()) != QUARRY_FORKED) failed |= 1;
    if (quarry_close(open.scene) != QUARRY_FORKED) failed |= 2;
    quarry_scene* own = nullptr;
    if (quarry_open(row.folder.file("s").c_str(), nullptr, &own) != QUARRY_OK) failed |= 4;
    if (quarry_any(own, &rays.given, any.data()) != QUARRY_OK || any[0] != 1) failed |= 8;
    if (quarry_close(own) != QUARRY_OK) failed |= 16;
    ::_exit(failed);
  }
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  REQUIRE(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 0);
  CHECK(quarry_any(open.scene, &rays.given, any.data()) == QUARRY_OK);
}

}  // namespace quarry::test
