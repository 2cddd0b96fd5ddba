#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/status.h"
#include "common/voxel/parts/part_attributes.h"
#include "common/voxel/store_names.h"

namespace quarry {

/// The facts of a part, as the section PTRE has them; its name is in PART.
/// Units: scene units, without META's offset. The box and the count are of the part's own triangles, without
/// those of the parts below it.
struct ScenePart {
  static constexpr uint32_t kNoParent = 0xFFFFFFFFu;
  /// Flags: the surface is closed, so that it has an inside; and it is closed with the outside in. A part
  /// with the second flag has the first too.
  static constexpr uint32_t kClosed = 1, kInsideOut = 2;
  static constexpr float kFar = std::numeric_limits<float>::infinity();

  uint32_t parent = kNoParent;  ///< a lower number than the part's own
  uint32_t flags = 0;
  uint64_t triangles = 0;               ///< of the input, dropped triangles included
  glm::vec3 lower{kFar}, upper{-kFar};  ///< without a triangle: kFar and -kFar
  bool operator==(const ScenePart&) const = default;
};
inline constexpr size_t kScenePartBytes = 40;
static_assert(sizeof(ScenePart) == kScenePartBytes, "part_tree.h states the memory");

/// Most parts on the way from a root to a part, itself included. It bounds paths.
inline constexpr uint32_t kMostPartLevels = 256;

/// The parts of a scene, for writing: names and facts by number, and what models state beside.
struct PartTable {
  std::vector<std::string> names;            ///< each part's own, without a zero in it
  std::vector<ScenePart> facts;              ///< as many
  std::vector<StatedAttributes> attributes;  ///< of some parts, by ascending number
};

/// Encode the section PTRE, and a voxel's piece of the section VPRT: its parts, in any order, repeated or
/// not.
Bytes EncodePartTree(std::span<const ScenePart> parts);
Bytes EncodePartList(std::vector<uint32_t> parts);

/// Reads VPRT list by list, through a window of 256 KiB. Not thread-safe; the file outlives the reader.
class PartListReader {
 public:
  PartListReader(const RandomAccessFile& file, StoreNames::Place place, uint64_t part_count)
      : file_(file), place_(place), part_count_(part_count) {}

  /// The next voxel's parts, ascending; valid until the next call. `triangles`: of the voxel.
  /// Errors: a read error; permanent: no part, more parts than triangles, a wrong order, a part that does not
  /// exist.
  Result<std::span<const uint32_t>> Next(uint32_t triangles);
  /// Errors, permanent: bytes are left after the last voxel's list.
  Status CheckEnd() const;

 private:
  Result<uint32_t> Number();
  tl::unexpected<Error> Damaged(const char* how) const;

  const RandomAccessFile& file_;
  StoreNames::Place place_;
  uint64_t part_count_;
  uint64_t read_ = 0;  ///< bytes of the section that have come into the window
  Bytes window_;
  size_t at_ = 0;  ///< within the window
  std::vector<uint32_t> parts_;
};

/// The sections PTRE, VPRT and PATT of a store's file, read when asked for. Thread-safe.
class PartSections {
 public:
  struct Places {
    StoreNames::Place tree, lists, attributes;
    bool has_tree = false, has_lists = false;
  };
  /// `file` and `names` must outlive this.
  PartSections(const RandomAccessFile& file, const StoreNames& names, const Places& places)
      : file_(file), names_(names), places_(places) {}

  bool has_tree() const { return places_.has_tree; }
  bool has_lists() const { return places_.has_lists; }
  /// The facts of all parts. Without the section: of roots about which nothing is known.
  /// Errors: a read error; permanent: another number of parts than PART has; a parent that does not come
  /// before its child, or kMostPartLevels; unknown flags; an impossible box; more triangles than
  /// `input_triangles` in all.
  Result<std::vector<ScenePart>> ReadTree(uint64_t input_triangles) const;
  /// The path of a part (part_path.h), empty when there is no such part. Errors: as ReadTree(), of the parts
  /// on the way.
  Result<std::string> Path(uint32_t part) const;
  /// Errors: as PartAttributes::Read().
  Result<PartAttributes> ReadAttributes() const {
    return PartAttributes::Read(file_, places_.attributes, names_.part_count());
  }
  /// Requires: has_lists().
  PartListReader Lists() const { return {file_, places_.lists, names_.part_count()}; }

 private:
  tl::unexpected<Error> Damaged(const std::string& how) const;
  Result<uint32_t> ParentOf(uint32_t part) const;

  const RandomAccessFile& file_;
  const StoreNames& names_;
  Places places_;
};

}  // namespace quarry
