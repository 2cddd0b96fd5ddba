#pragma once

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "common/kdtree/trace/triangle_test.h"
#include "tests/support/models/made_store.h"
#include "tests/support/rendering/resident_scene.h"
#include "tests/support/temporary_folder.h"

namespace quarry::test {

/// A triangle as stored.
struct StoredTriangle {
  glm::vec3 vertices[3];
  uint32_t id;
  bool glass;     ///< light passes its material
  uint32_t mask;  ///< opacity_mask.h
  const FineMask* fine;

  OpacityState StateOf(const Hit& hit) const { return StateAt(mask, fine, hit.b1, hit.b2); }
  bool HasHoleAt(const Hit& hit) const { return StateOf(hit) == OpacityState::kTransparent; }
  /// Whether it ends any-hit rays that hit it so.
  bool EndsRaysAt(const Hit& hit) const { return !glass && StateOf(hit) == OpacityState::kOpaque; }
};

/// The opacity mask of the triangle with an id, which may name a fine mask of the scene.
using MaskOf = std::function<uint32_t(uint32_t id)>;

/// Whether a part is hidden.
using IsHidden = std::function<bool(uint32_t part)>;

/// A model preprocessed into voxels, all of them decoded. With `mask_of`, triangles have opacity masks. Parts
/// may be hidden: brute force sees their triangles as holes.
class LoadedScene {
 public:
  LoadedScene(const std::string& model, uint32_t voxel_size, const MaskOf& mask_of = {},
              const IsHidden& is_hidden = {}, const std::vector<FineMask>& fine = {})
      : fine_(fine) {
    const std::string store = folder_.file("scene.quarry");
    MakeStore({.models = {model}, .output = store, .threads = 2, .voxel_size = voxel_size});
    auto scene = ResidentScene::Load(store);
    INFO((scene ? "" : scene.error().message));
    REQUIRE(scene.has_value());
    scene_ = std::move(*scene);
    if (mask_of) scene_->SetMasks(mask_of, fine);
    if (is_hidden) scene_->Hide(is_hidden);
    ListTriangles(mask_of);
  }

  const Catalog& catalog() const { return scene_->catalog(); }
  const std::vector<VoxelGeometry>& voxels() const { return scene_->voxels(); }
  ResidentScene& resident() const { return *scene_; }
  /// Each triangle once, in the order of ids.
  const std::vector<StoredTriangle>& triangles() const { return triangles_; }

  /// Traces one ray to its end; whether it hits.
  template <bool kAnyHit>
  bool TraceOne(Ray& ray) const {
    static const Kernel& kernel = BestKernel(Grouping::kStream);
    auto packet = std::make_unique<RayPacket>();
    packet->Set(0, ray);
    const uint64_t one = 1;
    (kAnyHit ? kernel.any : kernel.closest)(scene_->view().top(), scene_->view().finder(), packet.get(), &one,
                                            1);
    ray.hit = packet->HitOf(0);
    return ray.hit.triangle != kNoTriangle;
  }

 private:
  void ListTriangles(const MaskOf& mask_of) {
    std::vector<bool> seen(catalog().meta.input_triangles);
    for (const VoxelGeometry& view : voxels()) {
      for (uint32_t t = 0; t < view.triangle_count; ++t) {
        const uint32_t global = view.triangle_ids[t];
        if (seen[global]) continue;
        seen[global] = true;
        triangles_.push_back({{view.vertex(t, 0), view.vertex(t, 1), view.vertex(t, 2)},
                              global,
                              LetsLightThrough(catalog().materials[view.materials[t]]),
                              view.hidden && view.is_hidden(t) ? kTransparentMask
                              : mask_of                        ? mask_of(global)
                                                               : kOpaqueMask,
                              fine_.data()});
      }
    }
    for (uint32_t v = 0; v < catalog().voxels.size(); ++v)
      CHECK(catalog().voxels[v].blocks[0].decoded <= catalog().meta.voxel_size);
    std::sort(triangles_.begin(), triangles_.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  }

  TemporaryFolder folder_;
  std::unique_ptr<ResidentScene> scene_;
  std::vector<FineMask> fine_;
  std::vector<StoredTriangle> triangles_;
};

/// The real models, or empty when they are not there.
inline std::string ScenesFolder() {
  const char* given = std::getenv("QUARRY_TEST_SCENES");
  const std::string folder = given ? given : QUARRY_SCENES_DIR;
  return std::filesystem::exists(folder) ? folder : std::string();
}

inline float Uniform(std::mt19937& random, float low, float high) {
  return low + (high - low) * static_cast<float>(random() >> 8) * 0x1p-24f;
}

inline glm::vec3 PointInBox(std::mt19937& random, const glm::vec3& lower, const glm::vec3& upper) {
  return {Uniform(random, lower.x, upper.x), Uniform(random, lower.y, upper.y),
          Uniform(random, lower.z, upper.z)};
}

inline glm::vec3 Unit(const glm::vec3& v) {
  const float length = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
  return length > 0 ? v / length : glm::vec3(1, 0, 0);
}

}  // namespace quarry::test
