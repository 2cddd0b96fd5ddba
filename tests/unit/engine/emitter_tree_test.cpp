#include "common/engine/integrators/path/emitter_tree.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <glm/geometric.hpp>
#include <random>

// Choices among emitters: their chances, and what they favour.

namespace quarry {
namespace {

std::vector<EmitterTree::Emitter> Scattered(size_t count, std::mt19937& random) {
  std::uniform_real_distribution<float> place(-10, 10), size(0, 0.5f);
  std::vector<EmitterTree::Emitter> emitters;
  for (size_t i = 0; i < count; ++i) {
    const glm::vec3 lower(place(random), place(random), place(random));
    const glm::vec3 normal = glm::normalize(glm::vec3(place(random), place(random), place(random)));
    emitters.push_back({lower, lower + glm::vec3(size(random), size(random), 0), normal, 0.1 + i % 7});
  }
  return emitters;
}

}  // namespace

TEST_CASE("Chances of emitters add up to one, and choices follow them", "[lamps]") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> number(0, 1);
  for (const size_t count : {1, 2, 3, 100, 1000}) {
    const auto emitters = Scattered(count, random);
    for (const bool by_power : {false, true}) {
      const EmitterTree tree(emitters, by_power);
      for (const glm::vec3& side : {glm::vec3(0), glm::vec3(0, 0, 1), glm::vec3(0.6f, 0, -0.8f)}) {
        INFO(count << " emitters, by power " << by_power << ", side " << side.x << ' ' << side.z);
        const glm::vec3 position(1, 2, -3);
        double sum = 0, power = 0, wrong = 0;
        for (const auto& e : emitters) power += e.power;
        for (uint32_t i = 0; i < count; ++i) {
          const auto chance = static_cast<double>(tree.ChanceOf(i, position, side));
          sum += chance;
          wrong += by_power && std::fabs(chance - emitters[i].power / power) > 1e-6;
        }
        // A cluster may reach above the surface though none of its emitters does: such choices find none.
        CHECK(sum < 1.0001);
        if (count >= 100 || side == glm::vec3(0)) CHECK(sum > 0.85);
        CHECK(wrong == 0);
        constexpr int kChoices = 20000;
        std::vector<int> met(count);
        for (int i = 0; i < kChoices; ++i) {
          const EmitterTree::Choice choice = tree.Choose(position, side, (i + number(random)) / kChoices);
          if (choice.chance == 0) continue;
          REQUIRE(choice.chance == tree.ChanceOf(choice.emitter, position, side));
          ++met[choice.emitter];
        }
        // Numbers are spread evenly, so that each is met as often as its chance says, but for one choice.
        for (uint32_t i = 0; i < count; ++i)
          REQUIRE(std::fabs(met[i] - kChoices * static_cast<double>(tree.ChanceOf(i, position, side))) < 3);
      }
    }
  }
}

TEST_CASE("Near emitters are chosen before far ones, and none below the surface", "[lamps]") {
  std::mt19937 random(4);
  auto emitters = Scattered(1000, random);
  for (auto& e : emitters) e.power = 1;
  const EmitterTree tree(emitters, false);
  const glm::vec3 position(0, 0, 0), up(0, 0, 1);
  double near = 0, far = 0, below = 0, count = 0;
  for (uint32_t i = 0; i < emitters.size(); ++i) {
    const glm::vec3 middle = (emitters[i].lower + emitters[i].upper) * 0.5f;
    const auto chance = static_cast<double>(tree.ChanceOf(i, position, up));
    if (emitters[i].upper.z <= 0) below += chance;
    const bool is_near = glm::length(middle) < 5;
    (is_near ? near : far) += chance;
    count += is_near;
  }
  CHECK(below == 0);
  CHECK(near > 5 * count / 1000);
  CHECK(near + far > 0.9);
  CHECK(tree.Choose({0, 0, 100}, up, 0.5).chance == 0);
}

TEST_CASE("Emitters at one place, and very far ones, have chances", "[lamps]") {
  const glm::vec3 up(0, 0, 1);
  std::vector<EmitterTree::Emitter> emitters(5, {glm::vec3(1), glm::vec3(1), up, 2.0});
  emitters.push_back({glm::vec3(1e15f), glm::vec3(1e15f), up, 1e-20});
  const EmitterTree tree(emitters, false);
  for (const glm::vec3& position : {glm::vec3(1), glm::vec3(0), glm::vec3(1e15f)}) {
    double sum = 0;
    for (uint32_t i = 0; i < emitters.size(); ++i)
      sum += static_cast<double>(tree.ChanceOf(i, position, glm::vec3(0)));
    CHECK(sum == Approx(1).epsilon(1e-4));
  }
}

}  // namespace quarry
