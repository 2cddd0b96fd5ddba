#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/kdtree/node.h"

// A voxel's tree as two streams, node by node in the order in which treelets hold them, so that decoding is
// one pass: see FORMAT.md.

namespace quarry {

/// A node's symbol: its axis, or this and the number of its references.
inline constexpr uint32_t kLeafSymbol = 3;

/// So many bits count a tree's planes.
inline constexpr uint32_t kPlaneBits = 21;
inline constexpr uint32_t kMostInnerNodes = (1u << kPlaneBits) - 2;

/// Appends the symbols and the planes of `slots`, a tree in treelets. Requires: kTreeletLevels, no more than
/// kMostInnerNodes.
void PutTree(std::span<const KdNode> slots, Bytes& out);

/// Reads them back; memory is kept from tree to tree.
class TreeReader {
 public:
  /// Lays the tree out in treelets; `slots` begins at a multiple of 16 bytes. Of leaves the first reference
  /// is left open, of headers the boxes. Errors: streams that are no tree; one that does not take just
  /// `slots`, or whose leaves have other than so many references. Requires: no more than kMostInnerNodes
  /// planes, and one symbol more than twice as many.
  Status Read(std::span<const std::byte> symbols, std::span<const std::byte> planes, uint32_t references,
              std::span<KdNode> slots);

 private:
  /// Where the next symbol comes from, and where in `slots` the next treelet goes.
  struct Position {
    size_t symbol = 0, slot = 0;
    uint64_t planes = 0;  ///< the next plane across each axis: kPlaneBits bits each
    uint64_t references = 0;
  };
  /// A treelet to come: where its root is, and the first pair of the one above.
  struct Root {
    uint32_t at, parent;
  };
  Status ReadPlanesOf(std::span<const std::byte> planes, Position& p);
  KdNode Next(Position& p) const;
  bool ReadTreelet(const Root& root, Position& position, std::span<KdNode> slots);

  std::vector<uint16_t> symbols_;
  std::vector<uint32_t> planes_;  ///< bits of floats, across x, y, z; a zero at the end
  std::vector<Root> roots_;
};

}  // namespace quarry
