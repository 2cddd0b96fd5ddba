// quarry-test-cad write MODEL PARTS SHAPES [UNIT]: writes an assembly, and prints its content as JSON.
// quarry-test-cad read MODEL [LINEAR ANGLE]: imports a model, and prints the imported parts as JSON.

#include <fmt/format.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/log.h"
#include "common/program/installed_program.h"
#include "common/voxel/parts/part_path.h"
#include "preprocess/import/ignoring_sink.h"
#include "preprocess/import/importer.h"
#include "tests/integration/models/cad_model_writer.h"

namespace quarry {
namespace {

using Json = nlohmann::ordered_json;

/// Adds up the parts of a model.
class PartSums : public IgnoringSink {
 public:
  uint32_t AddMaterial(const Material& material) override {
    colors_.push_back(material.name);
    return static_cast<uint32_t>(colors_.size() - 1);
  }
  uint32_t AddPart(std::string_view name, uint32_t parent) override {
    std::string path = parent == kNoIndex ? "" : parts_.at(parent).path;
    AppendToPath(name, path, parent == kNoIndex);
    const auto [it, is_new] = numbers_.try_emplace(path, static_cast<uint32_t>(parts_.size()));
    if (is_new) parts_.push_back({path, 0, {}, 0});
    return it->second;
  }
  Status AddPosition(const glm::dvec3& position, const Rgba8&) override {
    points_.push_back(position);
    return {};
  }
  Status AddNormal(const glm::vec3& normal) override {
    normals_.push_back(normal);
    return {};
  }
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t number) override {
    Part& part = parts_.at(number == kNoIndex ? AddPart("", kNoIndex) : number);
    const glm::dvec3 &a = points_.at(corners[0].position), &b = points_.at(corners[1].position),
                     &c = points_.at(corners[2].position);
    const glm::dvec3 u = b - a, v = c - a;
    const glm::dvec3 cross{u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
    part.volume += (a.x * cross.x + a.y * cross.y + a.z * cross.z) / 6;
    if (material != kNoIndex) part.colors.insert(colors_.at(material));
    ++part.triangles;
    for (const Corner& corner : corners)
      if (corner.normal != kNoIndex) AddTurn(cross, normals_.at(corner.normal));
    return {};
  }
  void Warn(std::string message) override { warnings_.push_back(std::move(message)); }
  void Note(std::string message) override { notes_.push_back(std::move(message)); }

  Json ToJson() const {
    Json parts = Json::array();
    for (const Part& part : parts_)
      if (part.triangles > 0)
        parts.push_back({{"path", part.path},
                         {"volume", part.volume},
                         {"colors", part.colors},
                         {"triangles", part.triangles}});
    return {{"parts", parts}, {"warnings", warnings_}, {"notes", notes_}, {"least_cosine", least_cosine_}};
  }

 private:
  struct Part {
    std::string path;
    double volume;
    std::set<std::string> colors;
    uint64_t triangles;
  };

  /// The angle between a triangle and the normal at its corner.
  void AddTurn(const glm::dvec3& cross, const glm::vec3& normal) {
    const double length = std::sqrt(cross.x * cross.x + cross.y * cross.y + cross.z * cross.z);
    if (length < 1e-12) return;
    least_cosine_ = std::min(
        least_cosine_, (cross.x * static_cast<double>(normal.x) + cross.y * static_cast<double>(normal.y) +
                        cross.z * static_cast<double>(normal.z)) /
                           length);
  }

  std::vector<Part> parts_;
  std::map<std::string, uint32_t> numbers_;
  std::vector<std::string> colors_, warnings_, notes_;
  std::vector<glm::dvec3> points_;
  std::vector<glm::vec3> normals_;
  double least_cosine_ = 1;
};

int Write(char** words, int count) {
  WantedAssembly wanted{std::atoi(words[1]), std::atoi(words[2])};
  if (count > 3) wanted.unit = words[3];
  wanted.apart = count > 4;
  const std::vector<WrittenPart> parts = WriteAssembly(words[0], wanted);
  Json json = Json::array();
  for (const WrittenPart& part : parts)
    json.push_back({{"path", part.path}, {"volume", part.volume}, {"colors", part.colors}});
  // Open CASCADE prints to standard output before.
  Print("\n" + json.dump() + "\n");
  return parts.empty() ? 1 : 0;
}

int Read(char** words, int count) {
  ::signal(SIGPIPE, SIG_IGN);
  CadReading reading{FindProgram("quarry-import-cad"), ""};
  if (count > 1) reading.linear = std::strtod(words[1], nullptr);
  if (count > 2) reading.angle = std::strtod(words[2], nullptr);
  PartSums sums;
  const Status status = ImportModel(words[0], sums, {}, 0, {}, reading);
  if (!status) {
    Log(status.error().message);
    return 1;
  }
  Print(sums.ToJson().dump() + "\n");
  return 0;
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  const std::string_view verb = argc > 1 ? argv[1] : "";
  if (verb == "write" && argc > 4) return quarry::Write(argv + 2, argc - 2);
  if (verb == "read" && argc > 2) return quarry::Read(argv + 2, argc - 2);
  quarry::Log("quarry-test-cad write MODEL PARTS SHAPES [UNIT [apart]] | read MODEL [LINEAR ANGLE]");
  return 2;
}
