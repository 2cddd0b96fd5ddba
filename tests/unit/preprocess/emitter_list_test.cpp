#include "preprocess/ingest/emitter_list.h"

#include <catch2/catch.hpp>
#include <cmath>

namespace quarry {
namespace {

TriangleRecord Triangle(uint32_t id, uint16_t material, float side) {
  TriangleRecord record;
  record.id = id;
  record.material = material;
  record.part = 7;
  record.vertices[0] = {0, 0, 0};
  record.vertices[1] = {side, 0, 0};
  record.vertices[2] = {0, side, 0};
  return record;
}

EmitterList WithLamps() {
  EmitterList list;
  Material lamp;
  list.NoteMaterial(0, lamp);
  CHECK(list.empty());
  lamp.emission = glm::vec3(1);
  list.NoteMaterial(1, lamp);
  lamp.emission = glm::vec3(4);
  list.NoteMaterial(2, lamp);
  CHECK_FALSE(list.empty());
  return list;
}

}  // namespace

TEST_CASE("Emitters are the triangles of materials that shine, by ascending id", "[path]") {
  EmitterList list = WithLamps();
  for (const uint32_t id : {5u, 2u, 9u, 3u}) list.Add(Triangle(id, static_cast<uint16_t>(id % 3), 1));
  const std::vector<Emitter> emitters = list.Take();
  REQUIRE(emitters.size() == 2);
  CHECK((emitters[0].triangle == 2 && emitters[0].material == 2 && emitters[0].part == 7));
  CHECK((emitters[1].triangle == 5 && emitters[1].corners[1] == glm::vec3(1, 0, 0)));
}

TEST_CASE("Emitters keep their places in a map", "[path]") {
  EmitterList list;
  Material screen;
  screen.textures = {{TextureUse::kEmission, 0}};
  list.NoteMaterial(1, screen);
  TriangleRecord record = Triangle(4, 1, 1);
  record.uvs[0] = {0.25f, 2};
  record.uvs[2] = {std::nanf(""), 1};
  list.Add(record);
  const std::vector<Emitter> emitters = list.Take();
  REQUIRE(emitters.size() == 1);
  CHECK(emitters[0].uvs[0] == glm::vec2(0.25f, 2));
  CHECK(emitters[0].uvs[2] == glm::vec2(0));
}

TEST_CASE("Of too many emitters the strongest stay, and of equal ones the first", "[path]") {
  EmitterList list = WithLamps();
  constexpr uint32_t kMany = 3 * kMostEmitters;
  // Every fourth is strong by its radiance, every 64th by its size; the rest are equal.
  for (uint32_t id = 0; id < kMany; ++id)
    list.Add(Triangle(id, id % 4 == 3 ? 2 : 1, id % 64 == 0 ? 10.0f : 1.0f));
  EmitterList again = WithLamps();
  {
    ByteWriter out;
    list.Save(out);
    const Bytes saved = out.Take();
    ByteReader in(saved);
    again.Restore(in);
    CHECK(in.done());
  }
  const std::vector<Emitter> emitters = list.Take();
  REQUIRE(emitters.size() == kMostEmitters);
  size_t strong = 0, weak = 0;
  for (const Emitter& emitter : emitters) {
    const bool is_strong = emitter.triangle % 4 == 3 || emitter.triangle % 64 == 0;
    (is_strong ? strong : weak)++;
    if (!is_strong) CHECK(emitter.triangle < kMany / 8);
  }
  CHECK(strong == kMany / 4 + kMany / 64);
  CHECK(strong + weak == kMostEmitters);
  CHECK(again.Take() == emitters);
}

}  // namespace quarry
