#pragma once

#include <catch2/catch.hpp>
#include <fstream>
#include <memory>
#include <string>

#include "tests/laboratory/scene.h"
#include "tests/reference/scene_fixture.h"
#include "tests/support/models/made_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry::laboratory {

/// The value of a result; an error ends the test.
template <class T>
T Must(Result<T> result) {
  if (!result) FAIL(result.error().message);
  return std::move(*result);
}

/// A store of a model, in a folder of its own, and the scene out of it.
class MadeScene {
 public:
  explicit MadeScene(const std::string& model, uint32_t voxel_size = 64 << 10) {
    test::MakeStore(
        {.models = {model}, .output = store(), .threads = 2, .voxel_size = voxel_size, .textures = false});
    scene_ = Must(LaboratoryScene::Load(store()));
  }
  LaboratoryScene& operator*() const { return *scene_; }
  LaboratoryScene* operator->() const { return scene_.get(); }
  std::string store() const { return folder_.file("scene.quarry"); }

 private:
  test::TemporaryFolder folder_;
  std::unique_ptr<LaboratoryScene> scene_;
};

/// A scene that quarry-scene makes.
inline MadeScene Generated(const std::string& kind, uint64_t triangles, uint32_t voxel_size = 64 << 10) {
  const test::TemporaryFolder folder;
  return MadeScene(test::GenerateScene(folder, kind, triangles), voxel_size);
}

/// A box on a floor before a mirror and a pane of glass, with a small clutter of triangles: rays of all
/// kinds.
inline std::string GlassModel(const test::TemporaryFolder& folder) {
  const std::string path = folder.file("glass.obj");
  std::ofstream(folder.file("glass.mtl"))
      << "newmtl floor\nKd 0.7 0.6 0.5\nnewmtl box\nKd 0.2 0.5 0.8\nKs 0.4 0.4 0.4\nNs 40\n"
         "newmtl mirror\nKd 0.1 0.1 0.1\nKs 0.8 0.8 0.8\nNs 200\nillum 3\n"
         "newmtl glass\nKd 0 0 0\nTf 0.8 0.5 0.6\nNi 1.5\nillum 6\nd 0.3\n";
  std::ofstream out(path);
  out << "mtllib glass.mtl\n";
  const auto quad = [&](const char* material, const char* corners) {
    out << "usemtl " << material << "\n" << corners << "f -4 -3 -2 -1\n";
  };
  quad("floor", "v -5 -5 0\nv 5 -5 0\nv 5 5 0\nv -5 5 0\n");
  quad("mirror", "v -4 4 0\nv 4 4 0\nv 4 4 4\nv -4 4 4\n");
  quad("glass", "v -2 -2 0.2\nv 0 -2.5 0.2\nv 0 -2.5 3\nv -2 -2 3\n");
  quad("glass", "v -1 1 3.5\nv 3 1 3.5\nv 3 3 3.2\nv -1 3 3.2\n");
  for (int i = 0; i < 60; ++i) {
    const double x = -2 + 0.07 * i, y = 0.5 + 0.02 * (i * 7 % 11), z = 0.3 + 0.03 * (i * 5 % 60);
    out << "v " << x << ' ' << y << ' ' << z << "\nv " << x + 0.3 << ' ' << y + 0.2 << ' ' << z << "\nv " << x
        << ' ' << y + 0.1 << ' ' << z + 0.4 << "\nusemtl box\nf -3 -2 -1\n";
  }
  return path;
}

}  // namespace quarry::laboratory
