#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/ply/ply_plan.h"
#include "preprocess/import/ply/ply_rows.h"

namespace quarry {

/// Bytes of a row's start in the usual form: a byte 3, and three indices of 32 bits.
inline constexpr uint32_t kTriangleBytes = 1 + 3 * 4;

/// Where the wanted values of a binary row lie. Thread-safe.
template <typename Source>
class PlyValues {
 public:
  /// Of the plan's steps from `first` on, which have no lists, the first at byte `offset` of the row.
  PlyValues(const PlyPlan& plan, size_t first, uint32_t offset) : end_(offset) {
    for (size_t i = first; i < plan.steps.size(); ++i) {
      const PlyStep& step = plan.steps[i];
      if (step.target != PlyStep::kSkip) wanted_.push_back({end_, step.type, step.target});
      end_ += SizeOf(step.type);
    }
  }
  void Load(const char* row, double* values) const {
    for (const Wanted& want : wanted_) values[want.slot] = Source::Load(row + want.offset, want.type);
  }
  bool empty() const { return wanted_.empty(); }
  /// The byte after the last step.
  uint32_t end() const { return end_; }

 private:
  struct Wanted {
    uint32_t offset;
    PlyType type;
    uint8_t slot;
  };
  std::vector<Wanted> wanted_;
  uint32_t end_;
};

/// Reads the rows of a PLY body, element after element, through the element's plan. `Source` is
/// AsciiPlySource or BinaryPlySource. Thread safety: none.
template <typename Source>
class PlyRowReader {
 public:
  explicit PlyRowReader(Source values) : source(std::move(values)) {}

  /// Reads the rows of `element` and calls `use` after each, which returns a Status. Requires: row_number is
  /// 0. Errors: from `use` or from the source; a row that does not fit the plan.
  template <typename Use>
  Status Read(const PlyElement& element, const PlyPlan& plan, Use&& use) {
    if constexpr (Source::kBinary)
      if (!plan.has_lists) return FixedRows(element, plan, use);
    return RowsOneByOne(element, plan, use);
  }

  /// Reads one row. Errors: as Read()'s.
  template <typename Use>
  Status ReadNext(const PlyElement& element, const PlyPlan& plan, Use&& use) {
    if (!ReadTriangle(plan))
      for (const PlyStep& step : plan.steps) {
        if (ReadStep(step)) [[likely]]
          continue;
        return RowFailure(element);
      }
    long_rows += source.EndRow();
    QUARRY_TRY(use());
    ++row_number;
    return {};
  }

  /// Errors: the file is too short for the element's rows of `bytes` bytes.
  Status ExpectRows(const PlyElement& element, uint32_t bytes) const {
    const uint64_t left = source.bytes().remaining();
    if (element.count <= left / bytes) return {};
    return source.FailHere(fmt::format(
        "the header promises {} rows of {} bytes for the element {}, but the file has {} bytes left",
        element.count, bytes, element.name, left));
  }

  /// Reads one value, or one list of a row. False: see RowFailure().
  bool ReadStep(const PlyStep& step) {
    if (step.target == PlyStep::kIndexList) return ReadIndexList(step);
    if (step.target == PlyStep::kUvList) return ReadUvList(step);
    if (!step.count_type) {
      double ignored;
      return source.Scalar(step.type, step.target == PlyStep::kSkip ? ignored : row.values[step.target]);
    }
    int64_t count;
    if (!source.Integer(*step.count_type, count)) return false;
    if (count < 0) complaint_ = " has a list of a negative length";
    return count >= 0 && source.SkipValues(step.type, static_cast<uint64_t>(count));
  }

  tl::unexpected<Error> RowFailure(const PlyElement& element) const {
    const std::string name =
        fmt::format("{} {} (counted from 0) of {}", element.name, row_number, element.count);
    return complaint_.empty() ? source.Failure(name) : source.FailHere(name + complaint_);
  }

  Source source;
  PlyRow row;
  uint64_t row_number = 0;  ///< of the element that is being read, from 0
  uint64_t long_rows = 0;   ///< lines with more values than the header names

 private:
  /// Binary rows without lists: values lie at fixed offsets, so a buffer full of rows goes through one loop.
  template <typename Use>
  Status FixedRows(const PlyElement& element, const PlyPlan& plan, Use&& use) {
    const PlyValues<Source> values(plan, 0, 0);
    const uint32_t stride = values.end();
    QUARRY_TRY(ExpectRows(element, stride));
    ModelReader& bytes = source.bytes();
    if (values.empty() && bytes.Skip(element.count * stride)) return {};
    for (; row_number < element.count; ++row_number) {
      if (!bytes.Ensure(stride)) return RowFailure(element);
      values.Load(bytes.data(), row.values);
      bytes.Consume(stride);
      QUARRY_TRY(use());
    }
    return {};
  }

  template <typename Use>
  Status RowsOneByOne(const PlyElement& element, const PlyPlan& plan, Use&& use) {
    while (row_number < element.count) QUARRY_TRY(ReadNext(element, plan, use));
    return {};
  }

  /// A row of the usual form, with scalars behind the indices, at once. False, and nothing is read, if the
  /// row is of another.
  bool ReadTriangle(const PlyPlan& plan) {
    if constexpr (!Source::kBinary) {
      return false;
    } else {
      if (plan.triangle_bytes == 0 || !source.bytes().Ensure(plan.triangle_bytes)) return false;
      const char* at = source.bytes().data();
      if (*at != 3) return false;
      const PlyType type = plan.steps[0].type;
      row.indices.resize(3);
      const bool is_signed = type == PlyType::kInt32;
      for (size_t k = 0; k < 3; ++k) {
        const auto index = Source::Word(at + 1 + 4 * k);
        row.indices[k] = is_signed ? int64_t{static_cast<int32_t>(index)} : int64_t{index};
      }
      at += kTriangleBytes;
      for (size_t i = 1; i < plan.steps.size(); ++i) {
        const PlyStep& step = plan.steps[i];
        if (step.target != PlyStep::kSkip) row.values[step.target] = Source::Load(at, step.type);
        at += SizeOf(step.type);
      }
      source.bytes().Consume(plan.triangle_bytes);
      return true;
    }
  }

  bool ReadIndexList(const PlyStep& step) {
    row.indices.clear();
    int64_t count;
    if (!source.Integer(*step.count_type, count)) return false;
    if (count < 0 || static_cast<uint64_t>(count) > kMaxPolygonCorners) {
      complaint_ = fmt::format(" has {} corners, where 0 to {} are possible", count, kMaxPolygonCorners);
      return false;
    }
    return source.Integers(step.type, static_cast<uint64_t>(count), row.indices);
  }

  bool ReadUvList(const PlyStep& step) {
    row.uvs.clear();
    int64_t count;
    if (!source.Integer(*step.count_type, count)) return false;
    if (count < 0 || static_cast<uint64_t>(count) > 2 * kMaxPolygonCorners) {
      complaint_ = fmt::format(" has {} texture coordinates, where 0 to {} are possible", count,
                               2 * kMaxPolygonCorners);
      return false;
    }
    for (; count > 0; --count) {
      double value;
      if (!source.Scalar(step.type, value)) return false;
      row.uvs.push_back(static_cast<float>(value));
    }
    return true;
  }

  std::string complaint_;  ///< why a step failed, if the source itself has no objection
};

}  // namespace quarry
