#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/voxel/parts/part_sections.h"

namespace quarry {

class StoreReader;

/// The parts of a scene as a tree, held in memory: names, boxes, search, and selection by paths
/// (parts/part_path.h). Stores without the section PTRE have only roots, about which nothing else is known.
/// Memory: at most 98 bytes a part, and its name; memory_bytes() is exact. Reading takes 2 bytes a part more.
/// Units: scene units, without META's offset. Immutable; thread-safe.
class PartTree {
 public:
  static constexpr uint32_t kNone = ScenePart::kNoParent;
  /// Most paths with stars in a Resolve(): each is compared with every part.
  static constexpr size_t kMostPatterns = 64;

  using Part = ScenePart;
  /// Of a part with all parts below it.
  struct Total {
    uint64_t triangles = 0;
    glm::vec3 lower{Part::kFar}, upper{-Part::kFar};
  };
  struct Found {
    std::vector<uint32_t> parts;  ///< ascending
    uint64_t total = 0;           ///< of all that were found
  };

  /// Errors: as PartSections::ReadTree(); the names cannot be read; permanent: entries refer to more names
  /// than the store has.
  static Result<std::shared_ptr<const PartTree>> Read(const StoreReader& store);

  uint32_t size() const { return static_cast<uint32_t>(parts_.size()); }
  /// Whether the store states parents, boxes and counts.
  bool has_tree() const { return has_tree_; }
  uint64_t memory_bytes() const;

  /// Each requires: part < size().
  const Part& operator[](uint32_t part) const { return parts_[part]; }
  const Total& total(uint32_t part) const { return totals_[part]; }
  std::string_view name(uint32_t part) const {
    return std::string_view(names_).substr(name_begin_[part], name_begin_[part + 1] - name_begin_[part] - 1);
  }
  std::string Path(uint32_t part) const;

  /// The children of a part, or the roots for kNone, by ascending number: how many, and `count` of them from
  /// the `from`th on, fewer at the end. Requires: parent < size() or kNone.
  uint32_t child_count(uint32_t parent) const { return child_begin_[parent + 2] - child_begin_[parent + 1]; }
  std::vector<uint32_t> Children(uint32_t parent, uint32_t from, uint32_t count) const;

  /// The parts whose names contain `text`, upper and lower case of ASCII alike; of these, `count` from the
  /// `from`th on. A `text` with a '/' that no backslash precedes is a piece of a path: found are the parts
  /// whose paths contain it.
  Found Find(std::string_view text, uint32_t from, uint32_t count) const;

  /// A bit for each part: the parts that one of `paths` names, and all below them. An exact path costs a
  /// look-up; stars are matched against whole paths.
  /// Errors, usage: a path that names nothing (the sentence has the nearest path); more than kMostPatterns
  /// paths with stars.
  Result<std::vector<uint64_t>> Resolve(std::span<const std::string> paths) const;

 private:
  PartTree() = default;
  void Index();
  size_t ListOf(uint32_t parent, std::string_view name) const;
  std::vector<uint32_t> Named(std::span<const uint32_t> parents, std::string_view name) const;
  std::vector<uint32_t> Exactly(const std::vector<std::string>& names) const;
  std::vector<uint32_t> Matching(std::string_view pattern) const;
  void FindNames(std::string_view text, std::vector<bool>& found) const;
  void FindPaths(const std::vector<std::string>& names, std::vector<bool>& found) const;
  bool EndsHere(uint32_t part, const std::vector<std::string>& names) const;
  uint32_t NearestChild(uint32_t parent, std::string_view name) const;
  Error NamesNothing(const std::string& path) const;

  bool has_tree_ = false;
  std::vector<Part> parts_;
  std::vector<Total> totals_;
  std::string names_;                  ///< each ended by a zero
  std::vector<uint32_t> name_begin_;   ///< by part, and the end
  std::vector<uint32_t> child_begin_;  ///< by parent + 1 (0: of roots), shifted by one; places in children_
  std::vector<uint32_t> children_;
  std::vector<uint32_t> heads_, next_;  ///< lists of the parts with one hash of parent and name
};

}  // namespace quarry
