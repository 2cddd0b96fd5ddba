#include "scenes/ply_writer.h"

#include <fmt/format.h>

#include <bit>
#include <cstring>
#include <sstream>

#include "common/scene/material_json.h"
#include "scenes/output_file.h"

namespace quarry::scenes {
namespace {

static_assert(std::endian::native == std::endian::little, "values are copied as they lie in memory");

constexpr size_t kPositionBytes = 12, kColorBytes = 3;
constexpr size_t kFaceBytes = 19;
constexpr size_t kHeaderBytes = 512;
constexpr uint64_t kMostVertices = 0xFFFFFFFFull;

/// The header of always the same size, so that it can be written again when the counts are known: a comment
/// takes up the difference, since not every reader accepts padded numbers.
std::string Header(uint64_t vertices, uint64_t faces, bool colors) {
  const std::string head = "ply\nformat binary_little_endian 1.0\ncomment made by quarry-scene\ncomment";
  const std::string tail = fmt::format(
      "\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n{}"
      "element face {}\nproperty list uchar uint vertex_indices\n"
      "property ushort material_index\nproperty uint part_index\nend_header\n",
      vertices, colors ? "property uchar red\nproperty uchar green\nproperty uchar blue\n" : "", faces);
  return head + std::string(kHeaderBytes - head.size() - tail.size(), ' ') + tail;
}

template <typename T>
char* Put(char* out, const T& value) {
  std::memcpy(out, &value, sizeof value);
  return out + sizeof value;
}

class PlyWriter : public MeshWriter {
 public:
  PlyWriter(std::unique_ptr<OutputFile> model, std::unique_ptr<OutputFile> library,
            const std::vector<Material>& materials, bool colors)
      : model_(std::move(model)),
        library_(std::move(library)),
        names_(materials, pending_),
        colors_(colors) {}

  int passes() const override { return 2; }

  Status BeginPass(int pass) override {
    pass_ = pass;
    if (pass == 0) return model_->Write(Header(0, 0, colors_));
    if (vertices_ > kMostVertices)
      return Fail(
          fmt::format("{} vertices are more than 32-bit indices reach; ask for fewer triangles.", vertices_));
    vertices_ = 0;
    return {};
  }

  Status BeginPart(uint32_t, const std::string& name) override {
    if (pass_ != 0) return {};
    names_.AddPart(name);
    return WritePending();
  }

  Status AddPiece(const Mesh& mesh, uint32_t part) override {
    if (pass_ == 0) {
      faces_ += mesh.faces.size();
      QUARRY_TRY(WriteVertices(mesh));
    } else {
      QUARRY_TRY(WriteFaces(mesh, part));
    }
    vertices_ += mesh.vertices.size();
    return {};
  }

  bool WantsPositions() const override { return pass_ == 0; }

  Status Complete() override {
    QUARRY_TRY(model_->Patch(0, Header(vertices_, faces_, colors_)));
    names_.Finish();
    QUARRY_TRY(WritePending());
    QUARRY_TRY(library_->Close());
    QUARRY_TRY(model_->Close());
    QUARRY_TRY(library_->Commit());
    return model_->Commit();
  }

 private:
  Status WritePending() {
    QUARRY_TRY(library_->Write(pending_.str()));
    pending_.str({});
    return {};
  }

  Status WriteVertices(const Mesh& mesh) {
    const size_t bytes = kPositionBytes + (colors_ ? kColorBytes : 0);
    for (const MeshVertex& vertex : mesh.vertices) {
      QUARRY_ASSIGN(char* out, model_->Reserve(bytes));
      out = Put(out, vertex.position.x);
      out = Put(out, vertex.position.y);
      out = Put(out, vertex.position.z);
      if (colors_) {
        out = Put(out, SrgbByte(vertex.r));
        out = Put(out, SrgbByte(vertex.g));
        Put(out, SrgbByte(vertex.b));
      }
      model_->Advance(bytes);
    }
    return {};
  }

  Status WriteFaces(const Mesh& mesh, uint32_t part) {
    const auto first = static_cast<uint32_t>(vertices_);
    for (const MeshFace& face : mesh.faces) {
      QUARRY_ASSIGN(char* out, model_->Reserve(kFaceBytes));
      out = Put(out, uint8_t{3});
      out = Put(out, first + face.a);
      out = Put(out, first + face.b);
      out = Put(out, first + face.c);
      out = Put(out, face.material);
      Put(out, part);
      model_->Advance(kFaceBytes);
    }
    return {};
  }

  std::unique_ptr<OutputFile> model_, library_;
  std::ostringstream pending_;
  MaterialJsonStream names_;
  bool colors_;
  int pass_ = 0;
  uint64_t vertices_ = 0, faces_ = 0;
};

}  // namespace

Result<std::unique_ptr<MeshWriter>> OpenPlyWriter(const std::string& path,
                                                  const std::vector<Material>& materials, bool colors) {
  QUARRY_ASSIGN(auto model, OutputFile::Create(path));
  QUARRY_ASSIGN(auto library, OutputFile::Create(MaterialJsonPath(path)));
  return std::make_unique<PlyWriter>(std::move(model), std::move(library), materials, colors);
}

}  // namespace quarry::scenes
