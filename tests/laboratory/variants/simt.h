#pragma once

#include <cstdint>
#include <vector>

#include "common/kdtree/ray_packet.h"
#include "tests/laboratory/scene.h"
#include "tests/laboratory/structures/grid.h"
#include "tests/laboratory/structures/kd_tree.h"

// The papers' structures on the CPU's vectors: each lane follows its own ray, and a lane whose ray ends takes
// the next ray. One frame for all structures, so that their times may be compared.

namespace quarry::laboratory {

/// The parts of a scene that the lanes read. Shapes: corners[12 * triangles], three corners a triangle of
/// four floats.
struct SimtScene {
  const float* corners;
  uint32_t triangles;
  float lower[3], upper[3];  ///< the scene's box
};

/// A grid, as UniformGrid has it.
struct SimtGrid {
  const uint32_t* cells;
  const uint32_t* list;
  uint32_t resolution[3];
  float size[3];
};

/// A tree, as TextureTree has it.
struct SimtTree {
  const TextureNode* nodes;
  const ExtendedSplit* extended;
  const uint32_t* list;
  NodePointer root;
};

/// Rays, and for each the bits of those to trace, as TraceFunction takes them.
struct SimtRays {
  RayPacket* packets;
  const uint64_t* active;
  uint32_t count;
};

/// Traces rays from t = 0 up to their `hit_t`. Results: hit_t, triangle (a place in the scene), b1 and b2 of
/// the packets. Thread-safe.
struct SimtFunctions {
  void (*brute)(const SimtScene&, SimtRays);
  void (*grid)(const SimtScene&, const SimtGrid&, SimtRays);
  void (*restart)(const SimtScene&, const SimtTree&, SimtRays);
  void (*backtrack)(const SimtScene&, const SimtTree&, SimtRays);
  const char* isa;
};
extern const SimtFunctions kSimtAvx2, kSimtAvx512;

/// The widest that this processor has.
const SimtFunctions& BestSimt();

/// The corners of SimtScene.
std::vector<float> CornersOf(const LaboratoryScene& scene);
SimtScene SceneOf(const LaboratoryScene& scene, const std::vector<float>& corners);
SimtGrid GridOf(const UniformGrid& grid);
SimtTree TreeOf(const TextureTree& tree);

}  // namespace quarry::laboratory
