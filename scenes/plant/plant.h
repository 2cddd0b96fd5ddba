#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>

#include "scenes/builder.h"
#include "scenes/random.h"

/// The power plant, after the one of the University of North Carolina: a main building of 50 by 40 m and 80 m
/// height around two boilers. The building is a grid of bays of 5 m on ten levels of 8 m:
///   * the hall, bays 3..6 x 2..5, open from floor to roof, with the boilers;
///   * around it the walkway, bays 2..7 x 1..6: free to a height of 2.6 m on each level, racks of pipes
///   above;
///   * outside that, bays filled with equipment; stairs in one corner, an entrance on the ground.
/// Each stage draws until the scene has `budget` triangles in all, or runs out of things sooner.
namespace quarry::scenes {

inline constexpr float kBay = 5.0f, kLevel = 8.0f;
inline constexpr int kBaysX = 10, kBaysY = 8, kLevels = 10;
inline constexpr float kSizeX = kBay * kBaysX, kSizeY = kBay * kBaysY, kSizeZ = kLevel * kLevels;

inline constexpr glm::vec3 kUp(0, 0, 1);

enum PlantMaterial : uint16_t {
  kConcrete,
  kCladding,
  kSteel,
  kGalvanised,
  kBluePaint,
  kGreenPaint,
  kYellowPaint,
  kRedPaint,
  kWhitePaint,
  kGreyPaint,
  kCopper,
  kRubber,
  kInsulation,
  kChrome,
  kPolished,
  kPane,
  kGravel,
  kRust,
  kPlantMaterials
};

struct Plant {
  Builder& b;
  uint64_t seed;
  double triangles;  ///< Of the whole scene.
  double item;       ///< Of a common part (a pipe, say): with more, parts get finer and more numerous.
};

// Whether bay (x, y) belongs to the hall, to the walkway around it, to the stairs; see above.
constexpr bool InHall(int x, int y) { return x >= 3 && x <= 6 && y >= 2 && y <= 5; }
constexpr bool InWalkway(int x, int y) { return x >= 2 && x <= 7 && y >= 1 && y <= 6 && !InHall(x, y); }
constexpr bool InStairs(int x, int y) { return x == 9 && y <= 1; }
/// Whether a bay holds equipment: not the entrance on the ground, not the flue at the top.
constexpr bool InEquipment(int x, int y, int level) {
  if (InHall(x, y) || InWalkway(x, y) || InStairs(x, y)) return false;
  return !(level == 0 && x < 2 && y == 3) && !(level == kLevels - 1 && x > 7 && (y == 3 || y == 4));
}

void DrawShell(Plant& plant, Budget budget);    ///< Ground, walls, windows, door, roof, chimney, outer tanks.
void DrawFrame(Plant& plant, Budget budget);    ///< Columns, girders.
void DrawFloors(Plant& plant, Budget budget);   ///< Gratings, railings, stairs.
void DrawBoilers(Plant& plant, Budget budget);  ///< Casings, tube walls, superheaters, drums, burners, flue.
void DrawEquipment(Plant& plant, Budget budget);  ///< Tanks, pumps, exchangers, cabinets, bundles of pipes.
void DrawRacks(Plant& plant, Budget budget);      ///< Pipes and cable trays over the walkway.
void DrawBolts(Plant& plant, Budget budget);      ///< On the columns, exactly up to the budget.

// Pipes (plant_pipes.cpp).

/// Draws a pipe of about `triangles` (at most twice as many), with flanges and valves where they fit the
/// budget.
void DrawPipe(Plant& plant, std::span<const glm::vec3> points, float radius, double triangles,
              Random& random);
/// A material for a pipe of this radius.
uint16_t PipeMaterial(float radius, Random& random);
/// A tint of one part: parts of one material differ a little, as age and dirt make them.
glm::vec3 Worn(Random& random);
/// Segments around an axis with which `rows` rows of quads cost about `triangles`.
int SegmentsFor(double triangles, int rows, int most);

}  // namespace quarry::scenes
