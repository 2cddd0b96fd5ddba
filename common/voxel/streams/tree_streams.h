#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/kdtree/node.h"

// A voxel's tree as two streams, symbols and planes, in the node order of treelets, so that decoding is one
// pass. FORMAT.md gives the bytes.

namespace quarry {

/// The symbol of an inner node is its axis; of a leaf, kLeafSymbol plus its number of references.
inline constexpr uint32_t kLeafSymbol = 3;

/// Bits of the counter of planes per axis: three counters fit in 64 bits.
inline constexpr uint32_t kPlaneBits = 21;
/// The limit that kPlaneBits sets.
inline constexpr uint32_t kMostInnerNodes = (1u << kPlaneBits) - 2;

/// Appends the symbols and planes of `slots`, a tree in treelets.
/// Requires: treelets of kTreeletLevels levels; at most kMostInnerNodes inner nodes.
void PutTree(std::span<const KdNode> slots, Bytes& out);

/// Reads trees that PutTree() wrote. Keeps memory from tree to tree. Not thread-safe.
class TreeReader {
 public:
  /// Lays the tree out in treelets in `slots`. Leaves' first references and headers' boxes are left open;
  /// TreeCompletion fills them.
  /// Requires: `slots` aligned to 16 bytes; at most kMostInnerNodes planes; 2 * planes + 1 symbols.
  /// Errors: the streams are no tree; the tree does not take exactly `slots`; its leaves have another number
  /// of references than `references`.
  Status Read(std::span<const std::byte> symbols, std::span<const std::byte> planes, uint32_t references,
              std::span<KdNode> slots);

 private:
  /// The next symbol to read, and the slot of the next treelet.
  struct Position {
    size_t symbol = 0, slot = 0;
    uint64_t planes = 0;  ///< the next plane of each axis: kPlaneBits bits each
    uint64_t references = 0;
  };
  /// A treelet still to be read: the slot of its root, and the first pair of the parent treelet.
  struct Root {
    uint32_t at, parent;
  };
  Status ReadPlanesOf(std::span<const std::byte> planes, Position& p);
  KdNode Next(Position& p) const;
  bool ReadTreelet(const Root& root, Position& position, std::span<KdNode> slots);

  std::vector<uint16_t> symbols_;
  std::vector<uint32_t> planes_;  ///< bits of floats: x, then y, then z; a zero at the end
  std::vector<Root> roots_;
};

}  // namespace quarry
