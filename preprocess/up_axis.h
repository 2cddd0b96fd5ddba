#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace quarry {

/// Judges by file names alone: 1 where all formats state y as their up axis (glTF, and Assimp converts to
/// it), 2 where all state z (3MF), else 0. Thread-safe.
uint32_t StatedUpAxis(const std::vector<std::string>& models);

/// Evidence about the up axis beside the triangles, which UpEvidence() weighs: positive for y.
struct UpHabit {
  double formats = 0;   ///< most OBJ files are exported with y up, most STL files with z: decides a toss
  double comments = 0;  ///< of their comments, or of habits of the programs that wrote them
  std::string format;   ///< the name of the one format that has a habit; else empty

  double evidence() const { return comments != 0 ? comments : formats; }
};

/// Reads the first bytes of the models; one that cannot be read, or standard input, has no habit.
UpHabit UpHabitOf(const std::vector<std::string>& models, uint64_t unpack_limit);

/// How sure a guess is.
enum class Sureness : uint8_t { kToss, kLikely, kSure };
inline constexpr const char* kSurenessNames[] = {"toss", "likely", "sure"};

/// A toss where triangles say little, or were overruled by a format's habit. `triangles`: UpEvidence().
/// Thread-safe.
Sureness SurenessOf(double triangles, const UpHabit& habit);

/// The line about a guess for the user. `axis`: 1 or 2. Thread-safe.
std::string GuessText(uint32_t axis, double triangles, const UpHabit& habit);

}  // namespace quarry
