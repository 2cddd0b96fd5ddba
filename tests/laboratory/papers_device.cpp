#include "tests/laboratory/papers_device.h"

#include <fmt/format.h>

#include "common/kdtree/variants/variant_kernels.h"
#include "tests/cuda/papers_cuda.h"

namespace quarry::laboratory {

Result<std::vector<Timing>> TimeOnDevice(const PapersScene& scene, int repetitions, bool brute_force) {
  cuda::DeviceTextures textures;
  TriangleCorners corners = scene.scene().corners();
  QUARRY_TRY(textures.Upload(corners));
  struct Structure {
    const char* name;
    cuda::PapersStructure kernels;
  };
  std::vector<Structure> structures;
  if (brute_force) structures.push_back({"brute", AllTriangles{}});
  GridView grid = scene.grid();
  QUARRY_TRY(textures.Upload(grid));
  structures.push_back({"grid", grid});
  constexpr const char* kNames[2][4] = {
      {"restart", "backtrack", "push-down", "ropes"},
      {"restart, ours", "backtrack, ours", "push-down, ours", "ropes, ours"}};
  for (size_t which = 0; which < 2; ++which) {
    TreeView tree = scene.tree(which);
    RopesView ropes = scene.ropes(which);
    QUARRY_TRY(textures.Upload(tree));
    QUARRY_TRY(textures.Upload(ropes));
    const auto& names = kNames[which];
    structures.push_back({names[0], KdRestart(tree)});
    structures.push_back({names[1], KdBacktrack(tree)});
    structures.push_back({names[2], KdPushDown(tree)});
    structures.push_back({names[3], ropes});
  }
  const auto count = static_cast<uint32_t>(scene.packets().size());
  QUARRY_ASSIGN(cuda::DeviceRays rays, cuda::DeviceRays::Make(count));
  QUARRY_TRY(rays.Put(scene.packets()));
  QUARRY_TRY(rays.Choose(ListRays(scene.active().data(), count)));
  std::vector<Timing> timings;
  std::vector<RayPacket> found(count);
  for (const Structure& structure : structures) {
    Timing timing{structure.name, {}};
    for (int r = 0; r <= repetitions; ++r) {
      QUARRY_TRY(rays.Reset());
      QUARRY_ASSIGN(const double seconds, cuda::TraceByPapers(structure.kernels, corners, rays));
      if (r > 0) timing.seconds.push_back(seconds);  // the first is not counted: the device is not warm
    }
    QUARRY_TRY(rays.Get(found));
    if (const uint64_t differences = scene.Differences(found))
      return Fail(fmt::format("{}: {} on the GPU finds other hits for {} rays", scene.name(), structure.name,
                              differences));
    timings.push_back(std::move(timing));
  }
  return timings;
}

}  // namespace quarry::laboratory
