#include "tests/laboratory/variants/simt.h"

#include <hwy/targets.h>

namespace quarry::laboratory {

const SimtFunctions& BestSimt() {
  return (hwy::SupportedTargets() & HWY_AVX3) != 0 ? kSimtAvx512 : kSimtAvx2;
}

std::vector<float> CornersOf(const LaboratoryScene& scene) {
  std::vector<float> corners;
  for (const KdTriangle& triangle : scene.triangles())
    for (const glm::vec3& p : triangle.vertices) corners.insert(corners.end(), {p.x, p.y, p.z, 0});
  return corners;
}

SimtScene SceneOf(const LaboratoryScene& scene, const std::vector<float>& corners) {
  const Box box = scene.box();
  return {corners.data(),
          static_cast<uint32_t>(scene.triangles().size()),
          {box.lower.x, box.lower.y, box.lower.z},
          {box.upper.x, box.upper.y, box.upper.z}};
}

SimtGrid GridOf(const UniformGrid& grid) {
  const GridResolution& n = grid.resolution();
  return {grid.cells().data,
          grid.list().data,
          {n[0], n[1], n[2]},
          {grid.size()[0], grid.size()[1], grid.size()[2]}};
}

SimtTree TreeOf(const TextureTree& tree) {
  return {tree.nodes().data, tree.extended().data, tree.list().data, tree.root()};
}

}  // namespace quarry::laboratory
