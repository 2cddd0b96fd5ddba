#include "scenes/scene.h"

#include <fmt/format.h>

#include <utility>

#include "common/base/check.h"
#include "common/scene/open_pbr.h"
#include "scenes/mesh_writer.h"
#include "scenes/output_file.h"

namespace quarry::scenes {
namespace {

using Maker = std::unique_ptr<Scene> (*)(const SceneOptions&);

const std::vector<std::pair<std::string, Maker>>& Makers() {
  static const std::vector<std::pair<std::string, Maker>> makers{
      {"plant", MakePlant},   {"city", MakeCity},       {"terrain", MakeTerrain},
      {"forest", MakeForest}, {"stadium", MakeStadium}, {"cornell", MakeCornell}};
  return makers;
}

/// Counts triangles on their way to the writer.
class Watched : public MeshReceiver {
 public:
  Watched(MeshWriter& writer, uint64_t total, const WatchProgress& watch)
      : writer_(writer), total_(total), watch_(watch) {}
  Status BeginPart(uint32_t part, const std::string& name) override { return writer_.BeginPart(part, name); }
  Status AddPiece(const Mesh& mesh, uint32_t part) override {
    QUARRY_TRY(writer_.AddPiece(mesh, part));
    done_ += mesh.faces.size();
    return watch_(done_, total_);
  }
  bool WantsPositions() const override { return writer_.WantsPositions(); }

 private:
  MeshWriter& writer_;
  uint64_t total_, done_ = 0;
  const WatchProgress& watch_;
};

Status WritePasses(const Scene& scene, const SceneOptions& options, MeshWriter& writer,
                   const WatchProgress& watch) {
  Watched receiver(writer, options.triangles * static_cast<uint64_t>(writer.passes()), watch);
  for (int pass = 0; pass < writer.passes(); ++pass) {
    QUARRY_TRY(writer.BeginPass(pass));
    Builder builder(receiver);
    try {
      scene.Draw(builder);
      builder.Finish();
    } catch (GenerationStopped& stopped) {
      return tl::unexpected<Error>(std::move(stopped.error));
    }
  }
  return {};
}

}  // namespace

const std::vector<std::string>& SceneKinds() {
  static const std::vector<std::string> kinds = [] {
    std::vector<std::string> names;
    for (const auto& [name, maker] : Makers()) names.push_back(name);
    return names;
  }();
  return kinds;
}

std::unique_ptr<Scene> MakeScene(const std::string& kind, const SceneOptions& options) {
  for (const auto& [name, maker] : Makers())
    if (name == kind) return maker(options);
  QUARRY_CHECK(!"a scene of this kind");
  return nullptr;
}

Status WriteScene(const Scene& scene, const SceneOptions& options, const std::string& path,
                  const WatchProgress& watch) {
  std::vector<Material> materials = scene.Materials();
  for (Material& material : materials) DeriveOpenPbr(material);
  QUARRY_ASSIGN(const auto writer, OpenMeshWriter(path, materials, options.colors));
  QUARRY_ASSIGN(const auto way, OutputFile::Create(WithExtension(path, ".path.json")));
  QUARRY_TRY(way->Write(CameraPathJson(scene.Path())));
  QUARRY_TRY(way->Close());
  QUARRY_TRY(WritePasses(scene, options, *writer, watch));
  QUARRY_TRY(writer->Complete());
  return way->Commit();
}

}  // namespace quarry::scenes
