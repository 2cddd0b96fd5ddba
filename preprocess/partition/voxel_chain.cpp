#include "preprocess/partition/voxel_chain.h"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "preprocess/partition/split.h"

namespace quarry {
namespace {

constexpr size_t kBins = 32;
constexpr size_t kLeastFilled = 4;  // a group has at least this part, 1 / n, of the most that it may have

/// Twice the centre of the reference's part in the cell.
float Centre(const KdReference& r, const Box& cell, int axis) {
  return std::max(r.lower[axis], cell.lower[axis]) + std::min(r.upper[axis], cell.upper[axis]);
}

struct Bin {
  Box box = EmptyBox();
  size_t count = 0;

  void Add(const Bin& other) {
    if (other.count == 0) return;
    box.Include(other.box.lower);
    box.Include(other.box.upper);
    count += other.count;
  }
};

class ChainSplitter {
 public:
  ChainSplitter(std::span<KdReference> references, const Box& cell, size_t most)
      : references_(references), cell_(cell), most_(most) {
    std::vector<std::pair<size_t, size_t>> left{
        {0, references.size()}};  // ranges still to split, the first range last
    while (!left.empty()) {
      const auto [begin, end] = left.back();
      left.pop_back();
      if (end - begin <= most_) {
        ends.push_back(end);
        continue;
      }
      const size_t middle = SplitRange(begin, end);
      left.emplace_back(middle, end);
      left.emplace_back(begin, middle);
    }
  }
  std::vector<size_t> ends;

 private:
  struct ObjectSplit {
    double cost = std::numeric_limits<double>::infinity();
    size_t smaller = 0;  ///< references in the smaller side
    int axis = -1;
    float first = 0, bins_per_unit = 0;  ///< of the centres
    size_t bin = 0;                      ///< the first bin of the right side
  };

  /// Splits a range in place; returns where the right side begins.
  size_t SplitRange(size_t begin, size_t end) {
    const ObjectSplit split = Best(begin, end);
    const auto range = references_.subspan(begin, end - begin);
    size_t middle = begin;
    if (split.axis >= 0) {
      const auto right = std::stable_partition(
          range.begin(), range.end(), [&](const KdReference& r) { return BinOf(r, split) < split.bin; });
      middle += static_cast<size_t>(right - range.begin());
    } else {
      const size_t groups = Groups(range.size());  // all equally full
      middle += range.size() * (groups / 2) / groups;
    }
    return middle;
  }

  size_t Groups(size_t count) const { return (count + most_ - 1) / most_; }

  size_t BinOf(const KdReference& r, const ObjectSplit& split) const {
    const float bin = (Centre(r, cell_, split.axis) - split.first) * split.bins_per_unit;
    return static_cast<size_t>(bin > 0 ? std::min(bin, kBins - 1.0f) : 0.0f);
  }

  /// The split after which a ray is expected to meet the fewest groups; axis -1: no split has a smaller side
  /// that is large enough.
  ObjectSplit Best(size_t begin, size_t end) const {
    const auto range = references_.subspan(begin, end - begin);
    ObjectSplit best;
    for (int axis = 0; axis < 3; ++axis) {
      float first = kInfinity, last = -kInfinity;
      for (const KdReference& r : range) {
        const float centre = Centre(r, cell_, axis);
        first = std::min(first, centre);
        last = std::max(last, centre);
      }
      if (!(last > first)) continue;
      ObjectSplit split{0, 0, axis, first, kBins / (last - first), 0};
      std::array<Bin, kBins> bins;
      for (const KdReference& r : range) {
        Bin& bin = bins[BinOf(r, split)];
        IncludeClipped({{r.lower[0], r.lower[1], r.lower[2]}, {r.upper[0], r.upper[1], r.upper[2]}}, cell_,
                       bin.box);
        ++bin.count;
      }
      std::array<Bin, kBins> right;  // sums over the bins from each bin on
      right[kBins - 1] = bins[kBins - 1];
      for (size_t b = kBins - 1; b-- > 0;) (right[b] = right[b + 1]).Add(bins[b]);
      Bin left;
      for (split.bin = 1; split.bin < kBins; ++split.bin) {
        left.Add(bins[split.bin - 1]);
        const Bin& rest = right[split.bin];
        split.smaller = std::min(left.count, rest.count);
        if (split.smaller < std::max<size_t>(most_ / kLeastFilled, 1)) continue;
        split.cost = static_cast<double>(left.box.half_area()) * static_cast<double>(Groups(left.count)) +
                     static_cast<double>(rest.box.half_area()) * static_cast<double>(Groups(rest.count));
        // Of equal costs, the more even split.
        if (split.cost < best.cost || (split.cost == best.cost && split.smaller > best.smaller)) best = split;
      }
    }
    return best;
  }

  const std::span<KdReference> references_;
  const Box cell_;
  const size_t most_;
};

}  // namespace

std::vector<size_t> SplitIntoChain(std::span<KdReference> references, const Box& cell, uint32_t most) {
  return std::move(ChainSplitter(references, cell, most).ends);
}

}  // namespace quarry
