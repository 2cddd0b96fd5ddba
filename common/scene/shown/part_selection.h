#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace quarry {

/// The lists of parts in a view file, by paths. A path names a part and all parts below it; `*` in a path
/// stands for any characters.
struct PartLists {
  /// A colour for some parts; without a colour they get their own back. Of two that name a part the later
  /// counts.
  struct Coloring {
    std::vector<std::string> parts;
    std::optional<glm::vec3> color;  ///< linear RGB
    bool operator==(const Coloring&) const = default;
  };
  std::vector<std::string> hide;
  std::optional<std::vector<std::string>> only;  ///< all other parts are hidden; applies before `hide`
  std::vector<Coloring> colors;

  bool empty() const { return hide.empty() && !only && colors.empty(); }
  bool operator==(const PartLists&) const = default;
};

/// A bit for each part.
using PartBits = std::vector<uint64_t>;
/// The bit of a part; false beyond the end.
inline bool HasPart(const PartBits& bits, uint32_t part) {
  return part / 64 < bits.size() && (bits[part / 64] >> part % 64 & 1) != 0;
}
inline void AddPart(PartBits& bits, uint32_t part) { bits[part / 64] |= uint64_t{1} << part % 64; }
inline PartBits NoParts(size_t parts) { return PartBits((parts + 63) / 64); }

/// The lists of a view, resolved for a scene once: programs exchange it by its id. Immutable when shared, so
/// thread-safe.
/// Memory: a bit for each part, two more with caps, two bytes with colours; a byte for each voxel. A renderer
/// adds a copy of the top-level tree if parts are hidden, see ShownParts.
struct PartSelection {
  /// The share of a voxel's triangles that is shown.
  enum class Shown : uint8_t { kAll, kSome, kNone };

  uint64_t id = 0;            ///< a hash of all below; never 0
  PartBits hidden;            ///< empty: no part is hidden
  std::vector<Shown> voxels;  ///< by voxel; empty as `hidden` is
  /// For caps: the closed parts, and the closed parts whose triangles face inward. Empty where no cap is
  /// wanted.
  PartBits closed, inverted;
  std::vector<glm::vec3> colors;   ///< linear RGB
  std::vector<uint16_t> color_of;  ///< by part: 0: its own; else a number in `colors`, plus 1

  bool hides() const { return !hidden.empty(); }
  /// The colour given to a part, or null.
  const glm::vec3* ColorOf(uint32_t part) const {
    const uint16_t color = part < color_of.size() ? color_of[part] : uint16_t{0};
    return color == 0 ? nullptr : &colors[color - 1];
  }
};

/// Limit of the colours of a selection.
inline constexpr size_t kMostPartColors = 4096;

/// The hash that is the selection's id, of its content.
uint64_t IdOf(const PartSelection& selection);

/// The parts that a view shows, and their colours. `lists` as in the view's file; `selection` is set once a
/// master has resolved them. Null: all parts as they are. Compared by id, or by content before that.
struct ViewParts {
  std::shared_ptr<const PartLists> lists;
  std::shared_ptr<const PartSelection> selection;

  uint64_t id() const { return selection ? selection->id : 0; }
  bool operator==(const ViewParts& other) const {
    if (id() != other.id()) return false;
    if (selection || lists == other.lists) return true;
    return lists && other.lists && *lists == *other.lists;
  }
};

}  // namespace quarry
