#pragma once

#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/voxel/parts/part_path.h"
#include "preprocess/import/importer.h"
#include "preprocess/import/model_sink.h"
#include "tests/support/temporary_folder.h"

namespace quarry {

/// Keeps all that an importer gives, and checks the contract of ModelSink.
struct RecordingSink : ModelSink {
  struct Polygon {
    std::vector<Corner> corners;
    uint32_t material, part;
    Rgba8 color;
    uint16_t smoothing;
  };

  std::string name;
  std::vector<Material> materials;
  std::vector<TextureImage> images;
  std::vector<NamedCamera> cameras;
  std::vector<NamedLight> lights;
  std::vector<std::string> parts, warnings;
  std::map<uint32_t, std::string> attributes;  ///< by part
  std::vector<glm::dvec3> positions;
  std::vector<Rgba8> colors;
  std::vector<glm::vec3> normals;
  std::vector<glm::vec2> uvs;
  std::vector<Polygon> polygons;
  Rgba8 face_color;
  uint16_t smoothing = kSmoothByAngle;
  uint64_t triangles = 0;
  bool ended = false;
  WorkTeam* helpers = nullptr;  ///< what team() returns

  Status BeginFile(std::string_view file) override {
    name = file;
    return {};
  }
  Status EndFile() override {
    ended = true;
    for (const Polygon& polygon : polygons)
      for (const Corner& corner : polygon.corners)
        if (corner.position >= positions.size() || !Within(corner.normal, normals.size()) ||
            !Within(corner.uv, uvs.size()))
          return Fail("a corner index beyond the elements given");
    return {};
  }
  uint32_t AddMaterial(const Material& material) override {
    materials.push_back(material);
    return static_cast<uint32_t>(materials.size() - 1);
  }
  /// `parts` are paths.
  uint32_t AddPart(std::string_view own, uint32_t parent) override {
    std::string part = parent == kNoIndex ? "" : parts.at(parent);
    AppendToPath(own, part, parent == kNoIndex);
    for (size_t i = 0; i < parts.size(); ++i)
      if (parts[i] == part) return static_cast<uint32_t>(i);
    parts.push_back(std::move(part));
    return static_cast<uint32_t>(parts.size() - 1);
  }
  uint32_t AddSibling(std::string_view own, uint32_t parent) override {
    const size_t before = parts.size();
    const uint32_t part = AddPart(own, parent);
    if (parts.size() > before) return part;
    parts.push_back(parts[part] + " again");
    return static_cast<uint32_t>(before);
  }
  void SetAttributes(uint32_t part, std::string json) override { attributes[part] = std::move(json); }
  void AddCamera(NamedCamera camera) override { cameras.push_back(std::move(camera)); }
  void AddLight(NamedLight light) override { lights.push_back(std::move(light)); }
  bool takes_textures() const override { return true; }
  Result<uint32_t> AddTexture(TextureImage image) override {
    images.push_back(std::move(image));
    return static_cast<uint32_t>(images.size() - 1);
  }
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override {
    positions.push_back(position);
    colors.push_back(color);
    return {};
  }
  Status AddNormal(const glm::vec3& normal) override {
    normals.push_back(normal);
    return {};
  }
  Status AddUv(const glm::vec2& uv) override {
    uvs.push_back(uv);
    return {};
  }
  Status SetFaceColor(const Rgba8& color) override {
    face_color = color;
    return {};
  }
  void SetSmoothing(uint16_t group) override { smoothing = group; }
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override {
    polygons.push_back({{corners.begin(), corners.end()}, material, part, face_color, smoothing});
    if (corners.size() >= 3) triangles += corners.size() - 2;
    return {};
  }
  WorkTeam* team() override { return helpers; }
  void Warn(std::string message) override { warnings.push_back(std::move(message)); }

  static bool Within(uint32_t index, size_t count) { return index == kNoIndex || index < count; }
};

using test::TemporaryFolder;

/// Imports `content` as a file of that name; the error's sentence without the folder, or "" if it went well.
inline std::string ImportText(const std::string& name, std::string_view content, ModelSink& sink) {
  const TemporaryFolder folder;
  const Status status = ImportModel(folder.Write(name, content), sink);
  if (status) return "";
  std::string message = status.error().message;
  const std::string prefix = folder.file("");
  for (size_t at; (at = message.find(prefix)) != std::string::npos;) message.erase(at, prefix.size());
  return message;
}

inline std::string ErrorOf(const std::string& name, std::string_view content) {
  RecordingSink sink;
  return ImportText(name, content, sink);
}

}  // namespace quarry
