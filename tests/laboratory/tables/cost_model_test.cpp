// The cost model of Purcell et al. 2002, section 3.2: costs of kernels, measured on a small picture, foretell
// the work of a larger one by another camera.
#include "tests/laboratory/machine/study_run.h"
#include "tests/laboratory/made_scene.h"
#include "tests/laboratory/structures/grid.h"
#include "tests/laboratory/tables/callgrind.h"
#include "tests/laboratory/tables/instructions.h"
#include "tests/support/skip.h"

namespace quarry::laboratory {
namespace {

/// Writes the camera that the bench finds beside a store.
CameraSpec SetCamera(const std::string& store, const char* eye, double x, double y, double z) {
  std::ofstream(std::filesystem::path(store).replace_extension(".path.json"))
      << "{\"frames\": [{\"eye\": [" << eye << "], \"at\": [0, 0, 1], \"up\": [0, 0, 1], \"fov\": 50}]}";
  return {.eye = {x, y, z}, .at = {0, 0, 1}, .up = {0, 0, 1}, .fov_degrees = 50};
}

std::vector<std::string> CommandFor(const std::string& store, const char* renderer, uint32_t size) {
  return {std::string(QUARRY_BIN_DIR) + "/quarry-bench-stream",
          store,
          "--only",
          renderer,
          "--size",
          std::to_string(size),
          "--cells",
          "16"};
}

double Error(double predicted, double counted) { return std::abs(predicted / counted - 1); }

TEST_CASE("The cost model predicts words and instructions within 5 %") {
  test::TemporaryFolder folder;
  MadeScene scene(GlassModel(folder));
  AddressSpace addresses = scene->addresses();
  const UniformGrid grid(scene->triangles(), scene->padding(), scene->box(),
                         CubicalResolution(scene->box(), 16), addresses);
  const StudyRunner<UniformGrid> runner(grid, addresses, {});
  for (const Renderer renderer : {Renderer::kRaycast, Renderer::kWhitted}) {
    const char* const name = kRendererNames[static_cast<uint32_t>(renderer)];
    INFO(name);
    const CameraSpec near = SetCamera(scene.store(), "-1, -7, 3", -1, -7, 3);
    const auto small = MakeView(*scene, renderer, near, 48, 48, 1);
    REQUIRE(small.has_value());
    const CountedRun measured = runner.CountedMultipass(Picture(*scene, renderer, *small), {}, 0);
    std::optional<Result<InstructionCount>> of_small, of_large;
    if (WhyNotCounted().empty()) of_small = CountKernelInstructions(CommandFor(scene.store(), name, 48));

    const CameraSpec other = SetCamera(scene.store(), "-3, -6, 4", -3, -6, 4);
    const auto large = MakeView(*scene, renderer, other, 96, 96, 1);
    REQUIRE(large.has_value());
    const CountedRun counted = runner.CountedMultipass(Picture(*scene, renderer, *large), {}, 0);
    uint64_t words = 0;
    for (const MemoryWords& of : counted.words) words += of.read + of.written + of.fetched;
    CHECK(counted.counts.rays > 3 * measured.counts.rays);
    CHECK(Error(PredictedWords(measured, counted.counts), static_cast<double>(words)) < 0.05);

    if (const std::string why = WhyNotCounted(); !why.empty()) {
      test::Skip("instructions of kernels: " + why);
      continue;
    }
    of_large = CountKernelInstructions(CommandFor(scene.store(), name, 96));
    INFO((*of_small ? "" : of_small->error().message) << (*of_large ? "" : of_large->error().message));
    REQUIRE((*of_small && *of_large));
    CHECK(Error(PredictedInstructions((*of_small)->instructions, counted.counts, false),
                static_cast<double>((*of_large)->all)) < 0.05);
  }
}

}  // namespace
}  // namespace quarry::laboratory
