#include "tests/fuzz/import_fuzz.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <string>
#include <vector>

#include "preprocess/import/importer.h"
#include "preprocess/import/polygon/triangulation.h"
#include "tests/unit/three_mf_builder.h"

namespace {

using namespace quarry;

/// Keeps counts only, and stops the program where the importer breaks ModelSink's contract.
struct CountingSink : ModelSink {
  uint64_t positions = 0, normals = 0, uvs = 0;
  Corner largest{0, 0, 0};
  std::vector<glm::vec3> places;
  Triangulator triangulator;

  Status BeginFile(std::string_view) override { return {}; }
  Status EndFile() override { return {}; }
  uint32_t AddMaterial(const Material& material) override {
    for (const TextureBinding& b : material.textures)
      for (const float value :
           {b.factor.x, b.factor.y, b.factor.z, b.factor.w, b.cutoff, b.transform[0], b.transform[5]})
        if (!std::isfinite(value)) std::abort();
    return 0;
  }
  uint32_t AddPart(std::string_view, uint32_t) override { return 0; }
  uint32_t AddSibling(std::string_view, uint32_t) override { return 0; }
  bool takes_textures() const override { return true; }
  Result<uint32_t> AddTexture(TextureImage image) override {
    if (image.model.empty() || image.file.empty() == image.content.empty()) std::abort();
    return 0;
  }
  Status AddPosition(const glm::dvec3& position, const Rgba8&) override {
    places.emplace_back(position);
    return ++positions, Status();
  }
  Status AddNormal(const glm::vec3&) override { return ++normals, Status(); }
  Status AddUv(const glm::vec2&) override { return ++uvs, Status(); }
  Status AddPolygon(std::span<const Corner> corners, uint32_t, uint32_t) override {
    if (corners.size() < 3) std::abort();
    for (const Corner& corner : corners) {
      if (corner.position == kNoIndex) std::abort();
      largest.position = std::max(largest.position, corner.position);
    }
    std::vector<glm::vec3> polygon;
    for (const Corner& corner : corners)
      if (corner.position < places.size()) polygon.push_back(places[corner.position]);
    const auto triangles = triangulator.Split(polygon);
    if (!triangles.empty() && triangles.size() != polygon.size() - 2) std::abort();
    for (const Triangulator::Triangle& t : triangles)
      if (std::max({t.a, t.b, t.c}) >= polygon.size()) std::abort();
    return {};
  }
  bool WantsOrigin() const override { return true; }
  void Warn(std::string) override {}
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  constexpr const char* kExtensions[] = {".ply", ".obj", ".stl", "", ".off", ".gltf", ".nff", ".3mf", ".3mf"};
  constexpr size_t kKinds = std::size(kExtensions);
  // The importers read files; this one lives in memory, under a link whose name has the extension.
  const std::string name = "quarry-import-fuzz-" + std::to_string(getpid()) + kExtensions[data[0] % kKinds];
  const std::string link = (std::filesystem::temp_directory_path() / name).string();
  const int fd = memfd_create("model", 0);
  std::string model(reinterpret_cast<const char*>(data) + 1, size - 1);
  // Checksums keep most changes of an archive from the reader of its model: of the last kind is the model
  // alone.
  if (data[0] % kKinds == kKinds - 1) model = Zip(ThreeMfParts(model), 0);
  if (fd < 0 || write(fd, model.data(), model.size()) != static_cast<ssize_t>(model.size())) std::abort();
  unlink(link.c_str());
  if (symlink(("/proc/self/fd/" + std::to_string(fd)).c_str(), link.c_str()) != 0) std::abort();
  CountingSink sink;
  const Status status = ImportModel(link, sink);
  if (status && sink.largest.position >= sink.positions) std::abort();
  if (!status && status.error().message.empty()) std::abort();
  unlink(link.c_str());
  close(fd);
  return 0;
}
