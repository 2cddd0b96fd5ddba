#include "common/voxel/environment/sky_table.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "common/math/elementary.h"

namespace quarry {
namespace {

constexpr int kMostExponent = 120;

/// Divides `numbers` by weights: appends the end of each share, counted from `begin`.
void Share(uint32_t begin, uint32_t numbers, std::span<const double> weights, std::vector<uint32_t>& ends) {
  double all = 0, below = 0;
  for (const double weight : weights) all += weight;
  for (const double weight : weights) {
    below += weight;
    const double share = all > 0 ? std::min(below / all, 1.0) : 0;
    ends.push_back(begin + static_cast<uint32_t>(share * static_cast<double>(numbers)));
  }
}

/// The beginning of a part where [0, size) has `parts` nearly equal ones, and the part of a texel.
uint32_t BeginOf(uint32_t part, uint32_t size, uint32_t parts) {
  return static_cast<uint32_t>(uint64_t{part} * size / parts);
}
uint32_t PartWith(uint32_t at, uint32_t size, uint32_t parts) {
  auto part = static_cast<uint32_t>(uint64_t{at} * parts / size);
  while (part + 1 < parts && BeginOf(part + 1, size, parts) <= at) ++part;
  return part;
}

}  // namespace

SkyCells::SkyCells(uint32_t width)
    : width_(width), columns_(std::min(width, kMostColumns)), rows_(std::min(width, kMostColumns) / 2) {
  cosines_.reserve(height() + 1);
  for (uint32_t row = 0; row <= height(); ++row) {
    double sine = 0, cosine = 1;
    SinCos(std::numbers::pi * row / height(), sine, cosine);
    cosines_.push_back(cosine);
  }
}

uint32_t SkyCells::CellOf(uint32_t x, uint32_t y) const {
  return PartWith(y, height(), rows_) * columns_ + PartWith(x, width_, columns_);
}

SkyCells::Rect SkyCells::RectOf(uint32_t cell) const {
  const uint32_t column = cell % columns_, row = cell / columns_;
  return {BeginOf(column, width_, columns_), BeginOf(row, height(), rows_),
          BeginOf(column + 1, width_, columns_), BeginOf(row + 1, height(), rows_)};
}

uint32_t SkyCells::PartsOf(uint32_t cell) const {
  const Rect r = RectOf(cell);
  return std::min(r.x1 - r.x0, kMostPartsAside) * std::min(r.y1 - r.y0, kMostPartsAside);
}

uint32_t SkyCells::PartOf(uint32_t cell, uint32_t x, uint32_t y) const {
  const Rect r = RectOf(cell);
  const uint32_t across = std::min(r.x1 - r.x0, kMostPartsAside),
                 down = std::min(r.y1 - r.y0, kMostPartsAside);
  return PartWith(y - r.y0, r.y1 - r.y0, down) * across + PartWith(x - r.x0, r.x1 - r.x0, across);
}

SkyCells::Rect SkyCells::RectOf(uint32_t cell, uint32_t part) const {
  const Rect r = RectOf(cell);
  const uint32_t w = r.x1 - r.x0, h = r.y1 - r.y0;
  const uint32_t across = std::min(w, kMostPartsAside), down = std::min(h, kMostPartsAside);
  const uint32_t column = part % across, row = part / across;
  return {r.x0 + BeginOf(column, w, across), r.y0 + BeginOf(row, h, down),
          r.x0 + BeginOf(column + 1, w, across), r.y0 + BeginOf(row + 1, h, down)};
}

double SkyCells::SolidAngle(const Rect& rect) const {
  return 2 * std::numbers::pi / width_ * (rect.x1 - rect.x0) * (CosineAt(rect.y0) - CosineAt(rect.y1));
}

SkyTable::SkyTable(SkyCells cells, const Facts& facts, std::span<const double> weights,
                   std::span<const Divided> divided)
    : cells_(std::move(cells)), facts_(facts) {
  std::vector<uint32_t> of_cells;
  Share(0, kNumbers, weights, of_cells);
  of_cells.back() = kNumbers;
  size_t next = 0;
  for (uint32_t cell = 0; cell < cells_.count(); ++cell) {
    first_.push_back(static_cast<uint32_t>(end_.size()));
    if (next == divided.size() || divided[next].cell != cell) {
      end_.push_back(of_cells[cell]);
      continue;
    }
    const uint32_t begin = cell == 0 ? 0 : of_cells[cell - 1];
    Share(begin, of_cells[cell] - begin, divided[next++].weights, end_);
    end_.back() = of_cells[cell];
  }
  first_.push_back(static_cast<uint32_t>(end_.size()));
}

SkyTable::Choice SkyTable::ChoiceOf(uint32_t cell, uint32_t place) const {
  const bool is_divided = first_[cell + 1] - first_[cell] > 1;
  const uint32_t begin = place == 0 ? 0 : end_[place - 1];
  return {is_divided ? cells_.RectOf(cell, place - first_[cell]) : cells_.RectOf(cell),
          static_cast<float>(end_[place] - begin) / static_cast<float>(kNumbers)};
}

SkyTable::Choice SkyTable::Chosen(float number) const {
  const auto wanted = static_cast<uint32_t>(number * static_cast<float>(kNumbers));
  const auto place = static_cast<uint32_t>(std::ranges::upper_bound(end_, wanted) - end_.begin());
  const auto cell = static_cast<uint32_t>(std::ranges::upper_bound(first_, place) - first_.begin()) - 1;
  return ChoiceOf(cell, place);
}

SkyTable::Choice SkyTable::Around(uint32_t x, uint32_t y) const {
  const uint32_t cell = cells_.CellOf(x, y);
  const bool is_divided = first_[cell + 1] - first_[cell] > 1;
  return ChoiceOf(cell, first_[cell] + (is_divided ? cells_.PartOf(cell, x, y) : 0));
}

Bytes SkyTable::Encode() const {
  ByteWriter out;
  out.Put(facts_.exponent);
  out.PutVec3(facts_.mean);
  out.Put(facts_.brightest);
  ByteWriter parts;
  uint32_t divided = 0;
  for (uint32_t cell = 0; cell < cells_.count(); ++cell) {
    const uint32_t begin = first_[cell], end = first_[cell + 1];
    out.Put(end_[end - 1] - (begin == 0 ? 0 : end_[begin - 1]));
    if (end - begin == 1) continue;
    ++divided;
    parts.Put(cell);
    for (uint32_t place = begin; place < end; ++place)
      parts.Put(end_[place] - (place == 0 ? 0 : end_[place - 1]));
  }
  out.Put(divided);
  out.PutArray(parts.bytes());
  return out.Take();
}

/// Reads the numbers of cells and parts.
Status SkyTable::TakeNumbers(ByteReader& in) {
  const auto wrong = [] { return Fail("the ENVR section has numbers that do not fit"); };
  const std::vector<uint32_t> of_cells = in.GetArray<uint32_t>(cells_.count());
  const auto divided = in.Get<uint32_t>();
  if (!in.ok() || divided > kMostDivided) return wrong();
  uint64_t end = 0;
  uint32_t left = divided, next = left > 0 ? in.Get<uint32_t>() : kNumbers;
  for (uint32_t cell = 0; cell < cells_.count(); ++cell) {
    first_.push_back(static_cast<uint32_t>(end_.size()));
    const uint64_t begin = end;
    end += of_cells[cell];
    if (end > kNumbers) return wrong();
    if (cell != next) {
      end_.push_back(static_cast<uint32_t>(end));
      continue;
    }
    uint64_t below = begin;
    for (const uint32_t numbers : in.GetArray<uint32_t>(cells_.PartsOf(cell))) {
      below += numbers;
      if (below > end) return wrong();
      end_.push_back(static_cast<uint32_t>(below));
    }
    // A cell of one part is no divided one.
    if (!in.ok() || below != end || cells_.PartsOf(cell) < 2) return wrong();
    next = --left > 0 ? in.Get<uint32_t>() : kNumbers;
    if (left > 0 && next <= cell) return wrong();
  }
  first_.push_back(static_cast<uint32_t>(end_.size()));
  return end == kNumbers && left == 0 && in.done() ? Status{} : Status(wrong());
}

Result<SkyTable> SkyTable::Decode(std::span<const std::byte> bytes, uint32_t width) {
  ByteReader in(bytes);
  Facts facts;
  facts.exponent = in.Get<int32_t>();
  facts.mean = in.GetVec3<glm::vec3>();
  facts.brightest = in.Get<float>();
  for (int c = 0; c < 3; ++c)
    if (!(facts.mean[c] >= 0 && std::isfinite(facts.mean[c])))
      return Fail("the ENVR section has a mean that cannot be");
  if (!in.ok() || facts.exponent < -kMostExponent || facts.exponent > kMostExponent ||
      !(facts.brightest > 0) || !std::isfinite(facts.brightest))
    return Fail("the ENVR section has facts that cannot be");
  SkyTable table(SkyCells(width), facts);
  QUARRY_TRY(table.TakeNumbers(in));
  return table;
}

}  // namespace quarry
