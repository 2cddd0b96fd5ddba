// The fetches of the shade kernels: a word of each triangle, its attributes only where it has them.
#include "tests/laboratory/machine/shade.h"

#include "tests/laboratory/machine/study_run.h"
#include "tests/laboratory/made_scene.h"
#include "tests/laboratory/structures/grid.h"

namespace quarry::laboratory {
namespace {

constexpr uint64_t kMaterialWords = 1, kAttributeWords = 18;

/// Two walls of a triangle each, which share no corner, so that nothing is smoothed.
std::string Walls(const test::TemporaryFolder& folder, bool normals) {
  std::string path = folder.file("walls.obj");
  std::ofstream(path) << "v -4 0 -4\nv 0 0 -4\nv -2 0 4\nv 0.5 0 -4\nv 4 0 -4\nv 2 0 4\n"
                      << (normals ? "vn 0 -1 0\nvn 0.1 -1 0\nf 1//1 2//2 3//1\nf 4//2 5//1 6//1\n"
                                  : "f 1 2 3\nf 4 5 6\n");
  return path;
}

struct Counted {
  MemoryWords color, shadow;
  MachineCounts counts;
};
Counted CountShading(MadeScene& scene, Renderer renderer) {
  const CameraSpec camera{.eye = {-1, -9, 1}, .at = {0, 0, 0.5}, .up = {0, 0, 1}, .fov_degrees = 60};
  const auto view = MakeView(*scene, renderer, camera, 48, 48, 1);
  REQUIRE(view.has_value());
  const Picture picture(*scene, renderer, *view);
  AddressSpace addresses = scene->addresses();
  const UniformGrid grid(scene->triangles(), scene->padding(), scene->box(),
                         CubicalResolution(scene->box(), 4), addresses);
  CountingMemory memory;
  Machine<UniformGrid, CountingMemory> machine(grid, picture, memory, addresses);
  machine.RunMultipass({}, {}, 0);
  const auto of = [&](KernelId kernel) {
    return memory.Of(static_cast<uint32_t>(kernel), DataKind::kShading);
  };
  return {of(KernelId::kColor), of(KernelId::kShadow), machine.counts()};
}

TEST_CASE("A hit fetches the word of its triangle, and attributes where the triangle has them") {
  test::TemporaryFolder folder;
  for (const bool normals : {false, true}) {
    MadeScene scene(Walls(folder, normals));
    CHECK((scene->attributes().data != nullptr) == normals);
    const Counted counted = CountShading(scene, Renderer::kRaycast);
    REQUIRE(counted.counts.shaded > 500);
    CHECK(counted.color.fetched ==
          counted.counts.shaded * (kMaterialWords + (normals ? kAttributeWords : 0)));
  }
}

TEST_CASE("A shadow ray fetches one word of each see-through triangle that tints it") {
  test::TemporaryFolder folder;
  MadeScene scene(GlassModel(folder));
  const Counted counted = CountShading(scene, Renderer::kShadow);
  CHECK(counted.shadow.fetched > 0);
  // A run takes up one hit, or that there is none.
  CHECK(counted.shadow.fetched < counted.counts.runs[static_cast<uint32_t>(KernelId::kShadow)]);
}

TEST_CASE("The word of a triangle keeps its material and whether it has attributes") {
  for (const uint32_t material : {0u, 7u, (1u << 31) - 1})
    for (const bool has : {false, true}) {
      const TriangleMaterial of = TriangleMaterial::Of(material, has);
      CHECK(of.material() == material);
      CHECK(of.has_attributes() == has);
    }
  static_assert(sizeof(TriangleMaterial) == 4 * kMaterialWords);
  static_assert(sizeof(TriangleAttributes) == 4 * kAttributeWords);
}

}  // namespace
}  // namespace quarry::laboratory
