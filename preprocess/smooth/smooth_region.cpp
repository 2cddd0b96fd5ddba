#include "preprocess/smooth/smooth_region.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "common/math/packed_normal.h"
#include "preprocess/smooth/border_normals.h"
#include "preprocess/smooth/corner_fans.h"

namespace quarry {
namespace {

/// Finds the normals of one region's triangles, pass by pass.
class RegionNormals {
 public:
  RegionNormals(const Box& cell, const SpillFile* border, double crease)
      : cell_(cell), border_(border), fans_(crease) {}

  /// `triangles`: of a pass, about; room is made for them.
  Status Begin(const HashShare& share, size_t triangles = 0) {
    share_ = share;
    fans_.Clear();
    fans_.Reserve(triangles);
    found_.clear();
    received_.clear();
    if (border_ == nullptr) return {};
    SpillReader reader(*border_);
    while (const std::byte* bytes = reader.Next()) {
      BorderNormal entry;
      std::memcpy(&entry, bytes, sizeof entry);
      if (share_.Has(entry.hash())) received_.push_back(entry);
    }
    std::ranges::sort(received_, {}, KeyOf);
    return reader.status();
  }

  /// Requires: triangles in the order of their numbers.
  void Add(const TriangleRecord& t, uint32_t number) {
    if (!IsSmoothed(t)) return;
    for (uint32_t k = 0; k < 3; ++k) {
      const uint32_t hash = HashOfPosition(t.vertices[k]);
      if (!share_.Has(hash)) continue;
      if (Contains(cell_, t.vertices[k]))
        fans_.Add(t, number, k, hash);
      else if (const auto received = std::ranges::lower_bound(received_, Key{t.id, k}, {}, KeyOf);
               received != received_.end() && KeyOf(*received) == Key{t.id, k})
        found_.push_back({number, k, received->normal});
    }
  }

  /// The normals of this pass, in any order.
  std::vector<CornerNormal>& Finish() {
    const std::vector<CornerNormal> solved = fans_.Solve();
    found_.insert(found_.end(), solved.begin(), solved.end());
    return found_;
  }

  const std::vector<CornerNormal>& found() const { return found_; }

 private:
  using Key = std::pair<uint32_t, uint32_t>;
  static Key KeyOf(const BorderNormal& entry) { return {entry.id, entry.corner()}; }

  const Box cell_;
  const SpillFile* border_;
  HashShare share_;
  CornerFans fans_;
  std::vector<BorderNormal> received_;
  std::vector<CornerNormal> found_;
};

void SetNormal(TriangleRecord& t, const CornerNormal& found) {
  t.normals[found.corner] = UnpackNormal(found.normal);
}

/// Reads the next normals of a pass's file.
class PassReader {
 public:
  explicit PassReader(const SpillFile& file) : reader_(file) { Next(); }
  Status status() const { return reader_.status(); }
  /// Sets the normals of the triangle `number`. Requires: numbers in order.
  void Apply(uint32_t number, TriangleRecord& t) {
    for (; has_next_ && next_.triangle == number; Next()) SetNormal(t, next_);
  }

 private:
  void Next() {
    const std::byte* bytes = reader_.Next();
    has_next_ = bytes != nullptr;
    if (has_next_) std::memcpy(&next_, bytes, sizeof next_);
  }
  SpillReader reader_;
  CornerNormal next_;
  bool has_next_ = false;
};

using Drop = std::function<bool(const TriangleRecord&)>;

/// Copies a file that is too large for memory, with normals, and without the triangles that `drop` selects.
Result<SpillFile> SmoothFile(const SpillFile& triangles, RegionNormals normals, const std::string& prefix,
                             const Drop& drop) {
  constexpr size_t kSmallBlock = 64 << 10;  // a region of 10 million triangles has 39 passes
  SpillFile::Options small;
  small.block_bytes = kSmallBlock;
  std::vector<SpillFile> found;
  HashShare share{0, HashShare::PassesFor(triangles.count())};
  for (; share.pass < share.passes; ++share.pass) {
    QUARRY_TRY(normals.Begin(share));
    uint32_t number = 0;
    QUARRY_TRY(ForEachRecord(triangles, 0, triangles.count(), [&](const TriangleRecord& t) -> Status {
      normals.Add(t, number++);
      return {};
    }));
    QUARRY_ASSIGN(SpillFile file, SpillFile::Open(fmt::format("{}normals-{}", prefix, share.pass),
                                                  sizeof(CornerNormal), 0, small));
    std::ranges::sort(normals.Finish(), {}, &CornerNormal::triangle);
    for (const CornerNormal& corner : normals.found()) QUARRY_TRY(file.Append(&corner));
    QUARRY_TRY(file.FinishWriting());
    found.push_back(std::move(file));
  }
  std::deque<PassReader> passes;
  for (const SpillFile& file : found) passes.emplace_back(file);
  const size_t bytes = std::max(triangles.element_bytes(), RecordBytes(Attributes::kNormals));
  QUARRY_ASSIGN(SpillFile smooth, SpillFile::Open(prefix + "smooth", bytes, 0));
  uint32_t number = 0;
  QUARRY_TRY(ForEachRecord(triangles, 0, triangles.count(), [&](const TriangleRecord& record) -> Status {
    TriangleRecord t = record;
    for (PassReader& pass : passes) pass.Apply(number, t);
    ++number;
    return drop && drop(t) ? Status{} : smooth.Append(&t);
  }));
  for (const PassReader& pass : passes) QUARRY_TRY(pass.status());
  QUARRY_TRY(smooth.FinishWriting());
  for (const SpillFile& file : found) file.Remove();
  return smooth;
}

/// Copies a file without the triangles that `drop` selects.
Result<SpillFile> KeptOf(const SpillFile& triangles, const std::string& prefix, const Drop& drop) {
  QUARRY_ASSIGN(SpillFile kept, SpillFile::Open(prefix + "kept", triangles.element_bytes(), 0));
  QUARRY_TRY(ForEachRecord(triangles, 0, triangles.count(), [&](const TriangleRecord& t) -> Status {
    return drop(t) ? Status{} : kept.Append(&t);
  }));
  QUARRY_TRY(kept.FinishWriting());
  return kept;
}

}  // namespace

Status SmoothRecords(std::vector<TriangleRecord>& records, const Box& cell, const SpillFile* border,
                     double crease) {
  RegionNormals normals(cell, border, crease);
  HashShare share{0, HashShare::PassesFor(records.size())};
  for (; share.pass < share.passes; ++share.pass) {
    QUARRY_TRY(normals.Begin(share, records.size() / share.passes));
    for (uint32_t i = 0; i < records.size(); ++i) normals.Add(records[i], i);
    for (const CornerNormal& found : normals.Finish()) SetNormal(records[found.triangle], found);
  }
  return {};
}

Result<TopSubtree> PartitionSmoothed(const SpillFile& triangles, const Region& region, const Box& content,
                                     const PartitionOptions& options, const SpillFile* border, double crease,
                                     const std::function<Status(VoxelTask)>& emit, const Drop& drop) {
  if (triangles.count() <= kMostInMemory) {
    QUARRY_ASSIGN(std::vector<TriangleRecord> records, LoadRecords(triangles, 0, triangles.count()));
    if (crease > 0) QUARRY_TRY(SmoothRecords(records, region.cell, border, crease));
    if (drop) std::erase_if(records, drop);
    return PartitionInMemory(records, region, options, emit);
  }
  if (crease <= 0 && !drop) return PartitionFile(triangles, region, content, options, emit);
  auto copy = crease > 0 ? SmoothFile(triangles, RegionNormals(region.cell, border, crease),
                                      options.spill_prefix, drop)
                         : KeptOf(triangles, options.spill_prefix, drop);
  if (!copy) return tl::unexpected<Error>(copy.error());
  auto part = PartitionFile(*copy, region, content, options, emit);
  copy->Remove();
  return part;
}

}  // namespace quarry
