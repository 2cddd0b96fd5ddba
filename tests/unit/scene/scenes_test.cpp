#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "common/scene/material_json.h"
#include "scenes/mesh_writer.h"
#include "scenes/obj_writer.h"
#include "scenes/scene.h"
#include "tests/support/temporary_folder.h"

namespace quarry::scenes {
namespace {

namespace fs = std::filesystem;

/// A folder that goes away with the test.
struct Folder {
  size_t Files() const {
    return static_cast<size_t>(std::distance(fs::directory_iterator(path), fs::directory_iterator()));
  }
  test::TemporaryFolder made;
  fs::path path = made.path();
};

std::string Contents(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

Status Write(const std::string& kind, uint64_t triangles, uint64_t seed, const fs::path& path) {
  const SceneOptions options{triangles, seed};
  return WriteScene(*MakeScene(kind, options), options, path, [](uint64_t, uint64_t) { return Status(); });
}

/// Keeps a whole small scene.
class Collect : public MeshReceiver {
 public:
  Status BeginPart(uint32_t part, const std::string& name) override {
    REQUIRE(part == parts.size());
    parts.push_back(name);
    return {};
  }
  Status AddPiece(const Mesh& mesh, uint32_t part) override {
    REQUIRE(part + 1 == parts.size());
    for (const MeshFace& face : mesh.faces) {
      REQUIRE(std::max({face.a, face.b, face.c}) < mesh.vertices.size());
      triangles.push_back(
          {mesh.vertices[face.a].position, mesh.vertices[face.b].position, mesh.vertices[face.c].position});
      materials.push_back(face.material);
    }
    return {};
  }
  std::vector<std::string> parts;
  std::vector<std::array<glm::vec3, 3>> triangles;
  std::vector<uint16_t> materials;
};

Collect Draw(const Scene& scene) {
  Collect collect;
  Builder builder(collect);
  scene.Draw(builder);
  builder.Finish();
  return collect;
}

/// The counts that a header claims and the content of the file.
struct Ply {
  explicit Ply(const fs::path& path) : bytes(Contents(path)) {
    std::istringstream in(bytes);
    for (std::string line; std::getline(in, line) && line != "end_header";) {
      if (line.rfind("element vertex ", 0) == 0) vertices = std::stoull(line.substr(15));
      if (line.rfind("element face ", 0) == 0) faces = std::stoull(line.substr(13));
    }
    body = static_cast<size_t>(in.tellg());
  }
  template <typename T>
  T At(size_t offset) const {
    T value;
    std::memcpy(&value, bytes.data() + offset, sizeof value);
    return value;
  }
  std::string bytes;
  size_t vertices = 0, faces = 0, body = 0;
};

TEST_CASE("Scenes have the requested number of triangles", "[scenes]") {
  for (const std::string& kind : SceneKinds())
    for (uint64_t count : {1000, 1337, 20000, 300000}) {
      CAPTURE(kind, count);
      const auto scene = MakeScene(kind, {count, 1});
      const Collect drawn = Draw(*scene);
      CHECK(std::abs(static_cast<double>(drawn.triangles.size()) - static_cast<double>(count)) <=
            0.01 * count);
      CHECK(scene->Path().size() == 60);
    }
}

TEST_CASE("Scenes are finite and name each part once", "[scenes]") {
  for (const std::string& kind : SceneKinds()) {
    CAPTURE(kind);
    const auto scene = MakeScene(kind, {50000, 3});
    Collect drawn = Draw(*scene);
    const size_t materials = scene->Materials().size();
    size_t degenerate = 0, wild = 0;
    for (size_t i = 0; i < drawn.triangles.size(); ++i) {
      const auto& t = drawn.triangles[i];
      const float area = glm::length(glm::cross(t[1] - t[0], t[2] - t[0]));
      if (!std::isfinite(area)) ++wild;
      if (area <= 0.0f) ++degenerate;
      if (drawn.materials[i] >= materials) ++wild;
    }
    CHECK(wild == 0);
    CHECK(degenerate <= drawn.triangles.size() / 1000);
    std::sort(drawn.parts.begin(), drawn.parts.end());
    CHECK(std::adjacent_find(drawn.parts.begin(), drawn.parts.end()) == drawn.parts.end());
  }
}

TEST_CASE("More triangles mean more parts", "[scenes]") {
  for (const std::string& kind : SceneKinds()) {
    CAPTURE(kind);
    CHECK(Draw(*MakeScene(kind, {1000, 1})).parts.size() < Draw(*MakeScene(kind, {400000, 1})).parts.size());
  }
}

TEST_CASE("The same seed gives the same bytes, and another seed gives others", "[scenes]") {
  const Folder folder;
  for (const std::string& kind : SceneKinds()) {
    CAPTURE(kind);
    REQUIRE(Write(kind, 20000, 5, folder.path / "a.ply"));
    REQUIRE(Write(kind, 20000, 5, folder.path / "b.ply"));
    REQUIRE(Write(kind, 20000, 6, folder.path / "c.ply"));
    CHECK(Contents(folder.path / "a.ply") == Contents(folder.path / "b.ply"));
    CHECK(Contents(folder.path / "a.materials.json") == Contents(folder.path / "b.materials.json"));
    // The Cornell box is the Cornell box.
    if (kind != "cornell") CHECK(Contents(folder.path / "a.ply") != Contents(folder.path / "c.ply"));
  }
}

TEST_CASE("Ply header agrees with its content", "[scenes]") {
  const Folder folder;
  for (const std::string& kind : SceneKinds()) {
    CAPTURE(kind);
    REQUIRE(Write(kind, 12345, 1, folder.path / "s.ply"));
    const Ply ply(folder.path / "s.ply");
    REQUIRE(ply.faces == 12345);
    REQUIRE(ply.bytes.size() == ply.body + 15 * ply.vertices + 19 * ply.faces);
    const auto library = ReadMaterialJson(folder.path / "s.materials.json");
    REQUIRE(library);
    size_t wrong = 0;
    for (size_t i = 0; i < ply.faces; ++i) {
      const size_t at = ply.body + 15 * ply.vertices + 19 * i;
      wrong += ply.At<uint8_t>(at) != 3;
      for (size_t k = 0; k < 3; ++k) wrong += ply.At<uint32_t>(at + 1 + 4 * k) >= ply.vertices;
      wrong += ply.At<uint16_t>(at + 13) >= library->materials.size();
      wrong += ply.At<uint32_t>(at + 15) >= library->parts.size();
    }
    CHECK(wrong == 0);
  }
}

TEST_CASE("Obj has the same vertices and triangles as ply", "[scenes]") {
  const Folder folder;
  REQUIRE(Write("plant", 20000, 1, folder.path / "s.ply"));
  REQUIRE(Write("plant", 20000, 1, folder.path / "s.obj"));
  const Ply ply(folder.path / "s.ply");
  std::ifstream obj(folder.path / "s.obj");
  size_t vertices = 0, faces = 0, groups = 0, moved = 0;
  for (std::string line; std::getline(obj, line);) {
    faces += line.rfind("f ", 0) == 0;
    groups += line.rfind("g ", 0) == 0;
    if (line.rfind("v ", 0) != 0) continue;
    glm::vec3 p;
    std::sscanf(line.c_str(), "v %f %f %f", &p.x, &p.y, &p.z);
    moved +=
        p.x != ply.At<float>(ply.body + 15 * vertices) || p.z != ply.At<float>(ply.body + 15 * vertices + 8);
    ++vertices;
  }
  CHECK(vertices == ply.vertices);
  CHECK(faces == ply.faces);
  CHECK(groups == ReadMaterialJson(folder.path / "s.materials.json")->parts.size());
  CHECK(moved == 0);
  CHECK(fs::exists(folder.path / "s.mtl"));
}

TEST_CASE("The plant reflects and has glass in both formats", "[scenes]") {
  const auto scene = MakeScene("plant", {100000, 1});
  const auto materials = scene->Materials();
  const Collect drawn = Draw(*scene);
  size_t mirrors = 0, glass = 0;
  for (uint16_t m : drawn.materials) {
    if (materials[m].transmittance.x > 0) {
      ++glass;
    } else if (materials[m].reflectance.x > 0) {
      ++mirrors;
    }
  }
  CHECK(mirrors > 100);
  CHECK(glass > 100);
  const std::string mtl = MtlText(materials);
  CHECK_THAT(mtl, Catch::Contains(
                      "newmtl chrome\nKd 0.08 0.08 0.08\nKs 0.75 0.75 0.75\nNs 800\nNi 1\nd 1\nillum 3\n"));
  CHECK_THAT(mtl, Catch::Contains("Tf 0.86 0.92 0.9\nNi 1.5\n"));
  CHECK_THAT(mtl, Catch::Contains("illum 7"));
}

TEST_CASE("The stadium's triangles are in its teapot", "[scenes]") {
  const Collect drawn = Draw(*MakeScene("stadium", {400000, 1}));
  glm::vec3 low(INFINITY), high(-INFINITY);
  size_t small = 0;
  for (const auto& t : drawn.triangles) {
    for (const glm::vec3& p : t) {
      low = glm::min(low, p);
      high = glm::max(high, p);
    }
    const auto in_teapot = [](const glm::vec3& p) {
      return std::abs(p.x) < 0.2f && std::abs(p.y) < 0.2f && p.z > 0.7f && p.z < 1.0f;
    };
    small += in_teapot(t[0]) && in_teapot(t[1]) && in_teapot(t[2]);
  }
  CHECK(high.x - low.x > 350);  // a box of 0.4 m: about a thousandth
  CHECK(static_cast<double>(small) > 0.8 * static_cast<double>(drawn.triangles.size()));
}

/// t of the hit of a ray along `direction`, or infinity; `front` tells the side.
float Hit(const std::array<glm::vec3, 3>& t, const glm::vec3& eye, const glm::vec3& direction, bool& front) {
  const glm::vec3 u = t[1] - t[0], v = t[2] - t[0], p = glm::cross(direction, v);
  const float determinant = glm::dot(u, p);
  if (std::abs(determinant) < 1e-12f) return INFINITY;
  const glm::vec3 s = eye - t[0], q = glm::cross(s, u);
  const float a = glm::dot(s, p) / determinant, b = glm::dot(direction, q) / determinant;
  if (a < 0 || b < 0 || a + b > 1) return INFINITY;
  const float distance = glm::dot(v, q) / determinant;
  front = determinant > 0;
  return distance > 0 ? distance : INFINITY;
}

TEST_CASE("Cameras stand outside of solids", "[scenes]") {
  for (const std::string kind : {"plant", "city", "stadium", "cornell"}) {
    const auto scene = MakeScene(kind, {60000, 1});
    const Collect drawn = Draw(*scene);
    const auto path = scene->Path();
    for (size_t frame = 0; frame < path.size(); ++frame) {
      CAPTURE(kind, frame);
      const glm::vec3 eye = path[frame].eye, ahead = glm::normalize(path[frame].at - eye);
      for (const glm::vec3& direction :
           {ahead, glm::vec3(0.01f, 0.02f, -1), glm::vec3(0.98f, 0.17f, 0.03f)}) {
        float nearest = INFINITY;
        bool nearest_front = true;
        for (const auto& triangle : drawn.triangles) {
          bool front = false;
          const float t = Hit(triangle, eye, direction, front);
          if (t < nearest) {
            nearest = t;
            nearest_front = front;
          }
        }
        // The back of a single-sided wall may be seen from far outside (the open box), never from within a
        // solid.
        CHECK((nearest_front || nearest > 3.0f));
        CHECK(nearest > 0.1f);
      }
    }
  }
}

TEST_CASE("The camera path is Json", "[scenes]") {
  const Folder folder;
  REQUIRE(Write("plant", 1000, 1, folder.path / "s.ply"));
  const auto json = nlohmann::json::parse(Contents(folder.path / "s.path.json"));
  REQUIRE(json["frames"].size() == 60);
  for (const char* key : {"eye", "at", "up"}) CHECK(json["frames"][59][key].size() == 3);
  CHECK(json["frames"][0]["fov"].is_number());
}

TEST_CASE("An error during writing leaves no file", "[scenes]") {
  for (const char* name : {"s.ply", "s.obj"}) {
    const Folder folder;
    const SceneOptions options{50000, 1};
    const Status status =
        WriteScene(*MakeScene("plant", options), options, folder.path / name,
                   [](uint64_t done, uint64_t) { return done > 9000 ? Fail("enough") : Status(); });
    REQUIRE_FALSE(status);
    CHECK(status.error().message == "enough");
    CHECK(folder.Files() == 0);
  }
}

TEST_CASE("An unknown extension is an unusable argument", "[scenes]") {
  const auto writer = OpenMeshWriter("scene.stl", {}, true);
  REQUIRE_FALSE(writer);
  CHECK(writer.error().exit_status() == 2);
}

// The program itself, which lies beside the tests.

/// Starts quarry-scene; `file_limit` bounds the size of its files as a full disk would.
pid_t Start(std::vector<std::string> arguments, rlim_t file_limit = RLIM_INFINITY) {
  const std::string program = fs::read_symlink("/proc/self/exe").parent_path() / "quarry-scene";
  REQUIRE(fs::exists(program));
  arguments.insert(arguments.begin(), program);
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    const rlimit limit{file_limit, file_limit};
    setrlimit(RLIMIT_FSIZE, &limit);
    if (!freopen("/dev/null", "w", stderr)) _exit(99);
    execv(program.c_str(), argv.data());
    _exit(99);
  }
  return child;
}

int ExitStatus(pid_t child) {
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/// VmHWM in KiB, 0 once the process has ended.
size_t PeakMemory(pid_t child) {
  std::ifstream status("/proc/" + std::to_string(child) + "/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return std::stoull(line.substr(6));
  return 0;
}

size_t PeakMemoryOfPlant(const Folder& folder, uint64_t triangles, const char* name) {
  const pid_t child =
      Start({"plant", "--triangles", std::to_string(triangles), "-o", folder.path / name, "--quiet"});
  // rusage counts the memory of the forked test too, hence the polling. The peak is reached early, and kept.
  size_t peak = 0;
  siginfo_t info{};
  while (waitid(P_PID, static_cast<id_t>(child), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
         info.si_pid == 0) {
    if (fs::exists(folder.path / (std::string(name) + ".partial-" + std::to_string(child))))
      peak = std::max(peak, PeakMemory(child));
    std::this_thread::sleep_for(std::chrono::microseconds(100));
  }
  CHECK(ExitStatus(child) == 0);
  return peak;
}

TEST_CASE("Memory does not grow with the triangles", "[scenes]") {
  const Folder folder;
  for (const char* name : {"s.ply", "s.obj"}) {
    const size_t small = PeakMemoryOfPlant(folder, 100000, name),
                 large = PeakMemoryOfPlant(folder, 3000000, name);
    CAPTURE(name, small, large);
    REQUIRE(small > 0);
    CHECK(large < small + 4096);
    CHECK(large < 24 * 1024);
  }
}

TEST_CASE("The program refuses unusable arguments", "[scenes]") {
  const Folder folder;
  const std::string out = folder.path / "s.ply";
  CHECK(ExitStatus(Start({})) == 2);
  CHECK(ExitStatus(Start({"volcano", "--triangles", "1000", "-o", out})) == 2);
  CHECK(ExitStatus(Start({"plant", "-o", out})) == 2);
  CHECK(ExitStatus(Start({"plant", "--triangles", "1M", "-o", out})) == 2);
  CHECK(ExitStatus(Start({"plant", "--triangles", "999", "-o", out})) == 2);
  CHECK(ExitStatus(Start({"plant", "--triangles", "1000000001", "-o", out})) == 2);
  CHECK(ExitStatus(Start({"plant", "--triangles", "1000", "-o", folder.path / "s.stl"})) == 2);
  CHECK(ExitStatus(Start({"plant", "--triangles", "1000", "-o", folder.path / "missing" / "s.ply"})) == 1);
  CHECK(folder.Files() == 0);
}

TEST_CASE("A full disk leaves no file", "[scenes]") {
  const Folder folder;
  CHECK(ExitStatus(
            Start({"plant", "--triangles", "500000", "-o", folder.path / "s.ply", "--quiet"}, 3000000)) == 1);
  CHECK(folder.Files() == 0);
}

TEST_CASE("An interrupt leaves no file", "[scenes]") {
  for (int signal : {SIGINT, SIGTERM}) {
    const Folder folder;
    const pid_t child = Start({"plant", "--triangles", "100000000", "-o", folder.path / "s.ply", "--quiet"});
    while (folder.Files() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    kill(child, signal);
    CHECK(ExitStatus(child) == 1);
    CHECK(folder.Files() == 0);
  }
}

}  // namespace
}  // namespace quarry::scenes
