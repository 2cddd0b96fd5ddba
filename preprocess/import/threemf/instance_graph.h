#pragma once

#include <cstdint>
#include <functional>
#include <glm/mat4x4.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/material.h"

namespace quarry {

/// Which objects of a 3MF are shown, and where: objects are used by other objects, as components, and by the
/// build. An object's instances are the ways from the build to it. They are counted before the first is made,
/// and never listed. Thread safety: none.
class InstanceGraph {
 public:
  /// Most uses in a file, of about 150 bytes each; most instances in all; most objects in each other.
  static constexpr size_t kMostUses = 1 << 18;
  static constexpr uint64_t kMostInstances = 1'000'000;
  static constexpr uint32_t kMostDepth = 64;
  /// As a user: the build.
  static constexpr uint32_t kBuild = kNoIndex;

  struct Use {
    uint32_t object, user;  ///< user: an object, or kBuild
    glm::dmat4 transform;   ///< from the object's coordinates to the user's
  };

  void Add(const Use& use) { uses_.push_back(use); }
  size_t uses() const { return uses_.size(); }
  bool IsShownByBuild() const;

  /// Lets the build use all objects that no other object uses.
  void ShowAll(uint32_t objects);
  /// Counts the instances. Returns an object that lies within itself, or deeper than kMostDepth. Requires:
  /// uses name objects below `objects`; no Add() follows.
  std::optional<uint32_t> Count(uint32_t objects);
  /// Instances of an object; at most 2^53.
  double count(uint32_t object) const { return counts_[object]; }

  /// Calls visit(transform to the world, the objects on the way to the build from the object itself on) for
  /// each instance of an object, in the order of the uses. Errors: the first of `visit`, which ends the
  /// calls.
  using Visit = std::function<Status(const glm::dmat4& world, const std::vector<uint32_t>& way)>;
  Status ForEach(uint32_t object, const Visit& visit) const;

 private:
  Status Climb(const glm::dmat4& to_here, std::vector<uint32_t>& way, const Visit& visit) const;

  std::vector<Use> uses_;        ///< after Count() by object
  std::vector<uint32_t> first_;  ///< of each object's uses; one more at the end
  std::vector<double> counts_;
};

}  // namespace quarry
