#include "common/voxel/streams/tree_streams.h"

#include <algorithm>
#include <cstring>

#include "common/base/check.h"
#include "common/kdtree/build/treelets.h"
#include "common/voxel/streams/byte_planes.h"

namespace quarry {
namespace {

constexpr uint32_t kMaxMembers = (1u << kTreeletLevels) - 1;

/// Collects the streams of a tree.
struct TreeWriter {
  std::vector<uint16_t> symbols;
  std::vector<uint32_t> planes[3];

  void Put(const KdNode& n) {
    if (n.is_leaf()) {
      QUARRY_CHECK_LE(n.count() + kLeafSymbol, 0xFFFFu);
      symbols.push_back(static_cast<uint16_t>(n.count() + kLeafSymbol));
      return;
    }
    symbols.push_back(static_cast<uint16_t>(n.axis()));
    planes[n.axis()].push_back(OrderedBits(n.split()));
  }
};

}  // namespace

void PutTree(std::span<const KdNode> slots, Bytes& out) {
  TreeWriter tree;
  tree.Put(slots[0]);
  for (size_t at = kTreeletHeaderSlots; at < slots.size();) {
    at += kTreeletHeaderSlots;
    for (size_t pairs = 1; pairs > 0; --pairs)
      for (const size_t end = at + 2; at < end; ++at) {
        tree.Put(slots[at]);
        if (!slots[at].is_leaf() && !slots[at].begins_treelet()) ++pairs;
      }
    at = (at + kTreeletHeaderSlots - 1) / kTreeletHeaderSlots * kTreeletHeaderSlots;
  }
  PutPlanes<uint16_t>(tree.symbols, out);
  QUARRY_CHECK_LE(tree.symbols.size() / 2, kMostInnerNodes);
  for (const std::vector<uint32_t>& planes : tree.planes) PutDifferences<uint32_t>(planes, out);
}

/// Reads the split planes: axis by axis, in node order. The symbols give the number of planes per axis.
Status TreeReader::ReadPlanesOf(std::span<const std::byte> planes, Position& p) {
  size_t count[3] = {};
  for (const uint16_t symbol : symbols_)
    for (uint16_t axis = 0; axis < 3; ++axis) count[axis] += symbol == axis;
  const size_t all = count[0] + count[1] + count[2];
  if (all != planes.size() / sizeof(uint32_t)) return Fail("voxel block: not as many inner nodes as planes");
  planes_.resize(all + 1);
  p.planes = uint64_t{count[0]} << kPlaneBits | uint64_t{count[0] + count[1]} << 2 * kPlaneBits;
  const std::span<uint32_t> there(planes_.data(), all);
  std::span<uint32_t> rest = there;
  for (const size_t n : count) {
    ReadDifferences(planes.first(n * sizeof(uint32_t)), rest.first(n));
    planes = planes.subspan(n * sizeof(uint32_t));
    rest = rest.subspan(n);
  }
  bool finite = true;
  constexpr uint32_t kExponent = 0x7F800000u;
  for (uint32_t& plane : there) {
    plane = std::bit_cast<uint32_t>(FromOrderedBits(plane));
    finite &= (plane & kExponent) != kExponent;
  }
  planes_[all] = 0;
  if (!finite) return Fail("voxel block: a plane is not finite");
  return {};
}

/// Returns the next node without its links. Branch-free: a branch on leaf or inner node
/// would be unpredictable.
inline KdNode TreeReader::Next(Position& p) const {
  const uint32_t symbol = symbols_[p.symbol++];
  const bool leaf = symbol >= kLeafSymbol;
  const uint32_t axis = leaf ? kLeafSymbol : symbol, count = leaf ? symbol - kLeafSymbol : 0;
  const uint32_t shift = axis * kPlaneBits;  // 63 for a leaf: the bit there is never set
  constexpr uint64_t kMask = (uint64_t{1} << kPlaneBits) - 1;
  const uint32_t plane = planes_[p.planes >> shift & kMask];
  p.planes += uint64_t{!leaf} << shift;
  p.references += count;
  return {leaf ? 0 : plane, count << KdNode::kLinkShift | axis};
}

/// Reads one treelet and pushes the treelets below it, the leftmost last. Returns: false when `slots` is too
/// small. The symbols suffice: a binary tree has one leaf more than inner nodes.
inline bool TreeReader::ReadTreelet(const Root& root, Position& position, std::span<KdNode> slots) {
  Position p = position;
  // Breadth first: the members, then the roots of the treelets below.
  uint32_t at[2 * kMaxMembers + 2], level[2 * kMaxMembers + 2];
  at[0] = root.at;
  level[0] = 0;
  const size_t base = p.slot + kTreeletHeaderSlots;
  uint32_t members = 0, known = 1;
  for (; members < known && level[members] < kTreeletLevels; ++members) {
    const size_t pair = base + 2 * members;
    if (pair + 2 > slots.size()) return false;
    uint32_t link = static_cast<uint32_t>(pair) << KdNode::kLinkShift;
    for (uint32_t side = 0; side < 2; ++side) {
      const KdNode node = slots[pair + side] = Next(p);
      link |= node.link == KdNode::Leaf(0, 0).link ? KdNode::kLeftEmpty << side : 0;
      at[known] = static_cast<uint32_t>(pair + side);
      level[known] = level[members] + 1;
      known += !node.is_leaf();
    }
    slots[at[members]].link |= link;
  }
  slots[root.at].link |= KdNode::kBeginsTreelet;
  // Clears the two slots left over before the next header. After an even number of members none are left
  // over, and the header's slots are cleared instead, which the header overwrites.
  const size_t header_at = p.slot, over = members % 2 != 0 ? base + 2 * size_t{members} : header_at;
  p.slot = base + (size_t{members} + 1) / 2 * kTreeletHeaderSlots;
  if (p.slot > slots.size()) return false;
  slots[over] = slots[over + 1] = {0, 0};
  const TreeletHeader header{{}, {}, root.parent, root.at};
  std::memcpy(static_cast<void*>(&slots[header_at]), &header, sizeof header);
  while (known > members) roots_.push_back({at[--known], static_cast<uint32_t>(base)});
  position = p;
  return true;
}

Status TreeReader::Read(std::span<const std::byte> symbols, std::span<const std::byte> planes,
                        uint32_t references, std::span<KdNode> slots) {
  constexpr auto kNotSoManySlots = "voxel block: not as many node slots as its tree takes";
  symbols_.resize(symbols.size() / sizeof(uint16_t));
  ReadPlanes<uint16_t>(symbols, symbols_);
  Position p;
  QUARRY_TRY(ReadPlanesOf(planes, p));
  if (slots.size() < kTreeletHeaderSlots) return Fail(kNotSoManySlots);
  std::fill_n(slots.begin(), kTreeletHeaderSlots, KdNode{0, 0});
  slots[0] = Next(p);
  p.slot = kTreeletHeaderSlots;
  roots_.clear();
  if (!slots[0].is_leaf()) roots_.push_back({0, 0});
  while (!roots_.empty()) {
    const Root root = roots_.back();
    roots_.pop_back();
    if (!ReadTreelet(root, p, slots)) return Fail(kNotSoManySlots);
  }
  if (p.symbol != symbols_.size()) return Fail("voxel block: nodes beyond the tree");
  if (p.slot != slots.size()) return Fail(kNotSoManySlots);
  if (p.references != references) return Fail("voxel block: leaves do not have all references");
  return {};
}

}  // namespace quarry
