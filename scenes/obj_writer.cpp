#include "scenes/obj_writer.h"

#include <fmt/compile.h>
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "scenes/output_file.h"

namespace quarry::scenes {
namespace {

constexpr size_t kLongestLine = 160;

std::string Colour(const char* key, const glm::vec3& c) {
  return fmt::format("{} {} {} {}\n", key, c.x, c.y, c.z);
}

bool IsSet(const glm::vec3& c) { return c.x > 0.0f || c.y > 0.0f || c.z > 0.0f; }

/// The illumination model of the MTL standard that means the same as `material`.
int Illumination(const Material& material) {
  if (IsSet(material.transmittance)) return material.fresnel ? 7 : 6;
  if (IsSet(material.reflectance)) return material.fresnel ? 5 : 3;
  return IsSet(material.specular) ? 2 : 1;
}

std::string MtlEntry(const Material& m) {
  const float opacity = 1.0f - std::max({m.transmittance.x, m.transmittance.y, m.transmittance.z});
  std::string text = fmt::format("newmtl {}\n", m.name);
  text += Colour("Kd", m.diffuse);
  text += Colour("Ks", IsSet(m.reflectance) ? m.reflectance : m.specular);
  text += fmt::format("Ns {}\n", m.shininess);
  if (IsSet(m.emission)) text += Colour("Ke", m.emission);
  if (IsSet(m.transmittance)) text += Colour("Tf", m.transmittance);
  text += fmt::format("Ni {}\nd {}\nillum {}\n\n", m.ior, opacity, Illumination(m));
  return text;
}

class ObjWriter : public MeshWriter {
 public:
  ObjWriter(std::unique_ptr<OutputFile> model, std::unique_ptr<OutputFile> mtl, const std::string& mtl_name,
            const std::vector<Material>& materials, bool colors)
      : model_(std::move(model)),
        mtl_(std::move(mtl)),
        mtl_name_(mtl_name),
        materials_(materials),
        colors_(colors) {}

  int passes() const override { return 1; }

  Status BeginPass(int) override {
    QUARRY_TRY(mtl_->Write(MtlText(materials_)));
    return model_->Write(fmt::format("# made by quarry-scene\nmtllib {}\n", mtl_name_));
  }

  Status BeginPart(uint32_t, const std::string& name) override {
    material_ = kNoIndex;  // Each group names its material: groups are often cut out of OBJ files.
    return model_->Write(fmt::format("g {}\n", name));
  }

  Status AddPiece(const Mesh& mesh, uint32_t) override {
    for (const MeshVertex& v : mesh.vertices) QUARRY_TRY(WriteVertex(v));
    for (const MeshFace& face : mesh.faces) QUARRY_TRY(WriteFace(face));
    vertices_ += mesh.vertices.size();
    return {};
  }

  Status Complete() override {
    QUARRY_TRY(mtl_->Close());
    QUARRY_TRY(model_->Close());
    QUARRY_TRY(mtl_->Commit());
    return model_->Commit();
  }

 private:
  Status WriteVertex(const MeshVertex& v) {
    QUARRY_ASSIGN(char* out, model_->Reserve(kLongestLine));
    const auto channel = [](uint8_t value) { return static_cast<float>(SrgbByte(value)) / 255.0f; };
    // Positions in the shortest form that reads back to the same bits; colours to the nearest of 256 steps.
    char* end = fmt::format_to(out, FMT_COMPILE("v {} {} {}"), v.position.x, v.position.y, v.position.z);
    if (colors_)
      end =
          fmt::format_to(end, FMT_COMPILE(" {:.4g} {:.4g} {:.4g}"), channel(v.r), channel(v.g), channel(v.b));
    *end++ = '\n';
    model_->Advance(static_cast<size_t>(end - out));
    return {};
  }

  Status WriteFace(const MeshFace& face) {
    if (face.material != material_) {
      material_ = face.material;
      QUARRY_TRY(model_->Write(fmt::format("usemtl {}\n", materials_[material_].name)));
    }
    QUARRY_ASSIGN(char* out, model_->Reserve(kLongestLine));
    const uint64_t first = vertices_ + 1;  // OBJ counts from 1.
    char* end =
        fmt::format_to(out, FMT_COMPILE("f {} {} {}\n"), first + face.a, first + face.b, first + face.c);
    model_->Advance(static_cast<size_t>(end - out));
    return {};
  }

  std::unique_ptr<OutputFile> model_, mtl_;
  std::string mtl_name_;
  std::vector<Material> materials_;
  bool colors_;
  uint32_t material_ = kNoIndex;
  uint64_t vertices_ = 0;
};

}  // namespace

std::string MtlText(const std::vector<Material>& materials) {
  std::string text = "# made by quarry-scene\n";
  for (const Material& material : materials) text += MtlEntry(material);
  return text;
}

Result<std::unique_ptr<MeshWriter>> OpenObjWriter(const std::string& path,
                                                  const std::vector<Material>& materials, bool colors) {
  const std::string mtl_path = WithExtension(path, ".mtl");
  QUARRY_ASSIGN(auto model, OutputFile::Create(path));
  QUARRY_ASSIGN(auto mtl, OutputFile::Create(mtl_path));
  return std::make_unique<ObjWriter>(std::move(model), std::move(mtl),
                                     std::filesystem::path(mtl_path).filename(), materials, colors);
}

}  // namespace quarry::scenes
