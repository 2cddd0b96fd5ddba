#include "tests/laboratory/tables/papers_device.h"

#include "tests/laboratory/gpu/device_trace.h"

namespace quarry::laboratory {

Result<DeviceTimes> TimeOnDevice(const PapersScene& scene, int repetitions, bool brute_force) {
  DeviceTextures textures;
  QUARRY_ASSIGN(const TriangleCorners corners, textures.Upload(scene.scene().corners()));
  struct Structure {
    std::string name;
    DeviceStructure kernels;
  };
  std::vector<Structure> structures;
  if (brute_force) structures.push_back({"brute", AllTriangles{}});
  QUARRY_ASSIGN(const GridView grid, textures.Upload(scene.grid().view()));
  structures.push_back({"grid", grid});
  for (size_t which = 0; which < 2; ++which) {
    QUARRY_ASSIGN(const TreeView tree, textures.Upload(scene.tree(which).view()));
    QUARRY_ASSIGN(const RopesView ropes, textures.Upload(scene.ropes(which).view()));
    structures.push_back({NameOf("restart", which), KdRestart(tree)});
    structures.push_back({NameOf("backtrack", which), KdBacktrack(tree)});
    structures.push_back({NameOf("push-down", which), KdPushDown(tree)});
    structures.push_back({NameOf("ropes", which), ropes});
  }
  const auto count = static_cast<uint32_t>(scene.packets().size());
  QUARRY_ASSIGN(cuda::DeviceRays rays, cuda::DeviceRays::Make(count));
  QUARRY_TRY(rays.Put(scene.packets()));
  QUARRY_TRY(rays.Choose(ListRays(scene.active().data(), count)));
  DeviceTimes times;
  std::vector<RayPacket> found(count);
  for (const Structure& structure : structures) {
    Timing timing{structure.name, {}};
    for (int r = 0; r <= repetitions; ++r) {
      QUARRY_TRY(rays.Reset());
      QUARRY_ASSIGN(const double seconds, TraceOnDevice(structure.kernels, corners, rays));
      if (r > 0) timing.seconds.push_back(seconds);  // the first is not counted: the device is not warm
    }
    times.timings.push_back(std::move(timing));
    QUARRY_TRY(rays.Get(found));
    times.differences = scene.Differences(found);
    if (times.differences == 0) continue;
    times.different = structure.name;
    break;
  }
  return times;
}

}  // namespace quarry::laboratory
