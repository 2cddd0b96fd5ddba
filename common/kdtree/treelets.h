#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/build.h"
#include "common/kdtree/node.h"
#include "common/kdtree/treelet_header.h"

// A tree laid out for climbing. Inner nodes are grouped into treelets of a few levels; before the first pair
// of each lies a header of 32 bytes with the box of the treelet's root and where to find the parent treelet.
// A ray that leaves a leaf climbs headers until one's box still holds it, and descends from there: the
// kd-backtrack of Foley & Sugerman 2005, section 2.2, with the box and the parent link kept per treelet
// instead of per node. With treelets of one level it is kd-backtrack itself; with one treelet for the whole
// tree it is kd-restart (section 2.1). Slot 0 is the root; treelets follow from
// slot 4 on, parents first. There are never fewer than four slots.

namespace quarry {

inline constexpr uint32_t kTreeletLevels = 4;     ///< what stores hold and kernels are tuned for
inline constexpr uint32_t kBacktrackLevels = 1;   ///< kd-backtrack
inline constexpr uint32_t kRestartLevels = 1000;  ///< kd-restart: more levels than any tree has

/// Lays `nodes` (root first, children side by side, no flags) out in treelets of at most `levels` levels.
/// Headers' boxes and links are left zero: FillTreeletHeaders derives them. Deterministic.
/// Requires: a valid tree.
std::vector<KdNode> LayOutTreelets(std::span<const KdNode> nodes, uint32_t levels);

/// Checks that `nodes` is just what LayOutTreelets makes of some tree with `levels`, and fills in the
/// headers; `box` is the root's cell. After success every link leads to a node of the array and every climb
/// ends. Errors: anything else. Leaves' payloads are the caller's to check.
Status FillTreeletHeaders(std::span<KdNode> nodes, uint32_t levels, const Box& box);

/// The tree without treelets again: root first, children side by side, no flags.
std::vector<KdNode> FlattenTreelets(std::span<const KdNode> nodes);

}  // namespace quarry
