#pragma once

#include <memory>
#include <random>
#include <string>

#include "common/math/next_float.h"
#include "preprocess/preprocess.h"
#include "tests/laboratory/trace.h"
#include "tests/reference/scene_fixture.h"

// Scenes and rays of the laboratory's tests.

namespace quarry::laboratory {
/// A model as a scene of the laboratory.
class TestScene {
 public:
  explicit TestScene(const std::string& model) {
    PreprocessOptions options;
    options.models = {model};
    options.output = folder_.file("scene.quarry");
    options.textures = false;
    options.quiet = true;
    const auto made = Preprocess(options);
    INFO((made ? "" : made.error().message));
    REQUIRE(made.has_value());
    auto loaded = LaboratoryScene::Load(options.output);
    INFO((loaded ? "" : loaded.error().message));
    REQUIRE(loaded.has_value());
    scene_ = std::move(*loaded);
  }
  LaboratoryScene& scene() const { return *scene_; }

 private:
  test::TemporaryFolder folder_;
  std::unique_ptr<LaboratoryScene> scene_;
};

/// A scene that quarry-scene makes.
inline TestScene Generated(const std::string& kind, uint64_t triangles) {
  const test::TemporaryFolder folder;
  return TestScene(test::GenerateScene(folder, kind, triangles));
}

/// A ray and its end.
struct TestRay {
  RayStart start;
  float t_end;
};

/// Rays of several kinds: inside, from beyond the box, along an axis with zeros of both signs, through a
/// vertex, along the border of a box, with an end that is a hit's t.
inline TestRay MakeRay(const LaboratoryScene& scene, std::mt19937& random) {
  const Box box = scene.box();
  const auto vertex = [&] {
    return scene.triangles()[random() % scene.triangles().size()].vertices[random() % 3];
  };
  glm::vec3 origin = test::PointInBox(random, box.lower, box.upper),
            target = test::PointInBox(random, box.lower, box.upper);
  glm::vec3 direction(0);
  const auto axis = static_cast<int>(random() % 3);
  switch (random() % 7) {
    case 0:
      direction = glm::vec3(random() % 2 ? 0.0f : -0.0f);
      direction[axis] = random() % 2 ? 1.0f : -1.0f;
      break;
    case 1:
      direction[axis] = random() % 2 ? 1.0f : -1.0f;
      origin = vertex();
      origin[axis] = direction[axis] > 0 ? box.lower[axis] : box.upper[axis];
      break;
    case 2:
      target = vertex();
      break;
    case 3: {  // from beyond the box, within kReach
      const glm::vec3 meta = glm::max(glm::abs(box.lower), glm::abs(box.upper));
      const float reach = std::max({meta.x, meta.y, meta.z}) * (kReach - 0.5f);
      origin = test::PointInBox(random, glm::vec3(-reach), glm::vec3(reach));
      target = vertex();
      break;
    }
    case 4:
      origin[axis] = random() % 2 ? box.lower[axis] : box.upper[axis];
      break;
    case 5:
      origin = vertex();
      target = vertex();
      break;
    default:
      break;
  }
  if (direction == glm::vec3(0)) direction = test::Unit(target - origin);
  TestRay ray{{{origin.x, origin.y, origin.z}, {direction.x, direction.y, direction.z}},
              NextBelow(kInfinity)};
  PlainMemory memory;
  if (random() % 4 == 0) ray.t_end = test::Uniform(random, 0, 1) * box.extent(axis);
  if (random() % 8 == 0) {
    const float t = BruteForce(scene, memory, ray.start, ray.t_end).t;
    ray.t_end = random() % 2 ? t : NextBelow(t);
  }
  return ray;
}

/// Whether hits are the same to the last bit.
inline bool Same(const Hit& a, const Hit& b) {
  const auto bits = [](float x) { return std::bit_cast<uint32_t>(x); };
  return a.triangle == b.triangle && bits(a.t) == bits(b.t) && bits(a.b1) == bits(b.b1) &&
         bits(a.b2) == bits(b.b2);
}

}  // namespace quarry::laboratory
