#include "tests/laboratory/machine/texture_cache.h"

#include <fmt/format.h>

#include <algorithm>

namespace quarry::laboratory {

namespace {

constexpr uint32_t kShortestLine = 4;
/// A bound against slips of the pen: no texture cache is as large.
constexpr uint64_t kMostBytes = uint64_t{256} << 20;

}  // namespace

Result<TextureCache> TextureCache::Create(const TextureCacheOptions& options) {
  if (options.line < kShortestLine)
    return BadUsage(
        fmt::format("A line of a texture cache has {} bytes or more, not {}.", kShortestLine, options.line));
  if (options.ways < 1) return BadUsage("A texture cache has 1 way or more, not 0.");
  if (options.bytes > kMostBytes)
    return BadUsage(fmt::format("A texture cache has at most {} bytes, not {}.", kMostBytes, options.bytes));
  const uint64_t set = uint64_t{options.line} * options.ways;
  if (options.bytes < set)
    return BadUsage(fmt::format("A texture cache of {} bytes is too small for one set of {} x {} bytes.",
                                options.bytes, options.ways, options.line));
  return TextureCache(options);
}

TextureCache::TextureCache(const TextureCacheOptions& options)
    : options_(options),
      lines_(options.bytes / (uint64_t{options.line} * options.ways) * options.ways, kNoLine) {}

bool TextureCache::Use(uint64_t line) {
  const auto first = lines_.begin() + static_cast<ptrdiff_t>(line % sets() * options_.ways);
  const auto end = first + options_.ways;
  const auto found = std::find(first, end, line);
  const bool hit = found != end;
  // The lines before it, or all but the last, become older by one.
  std::move_backward(first, hit ? found : end - 1, hit ? found + 1 : end);
  *first = line;
  return hit;
}

uint32_t TextureCache::Access(uint64_t address, uint32_t bytes) {
  if (bytes == 0) return 0;
  const uint64_t first = address / options_.line, last = (address + bytes - 1) / options_.line;
  uint32_t misses = 0;
  for (uint64_t line = first; line <= last; ++line) misses += Use(line) ? 0 : 1;
  ++totals_.accesses;
  totals_.misses += misses;
  totals_.hits += last - first + 1 - misses;
  return misses;
}

uint32_t TextureCache::Access(DataKind kind, uint64_t address, uint32_t bytes) {
  const CacheTotals before = totals_;
  const uint32_t misses = Access(address, bytes);
  CacheTotals& totals = by_kind_[static_cast<uint32_t>(kind)];
  totals.accesses += totals_.accesses - before.accesses;
  totals.hits += totals_.hits - before.hits;
  totals.misses += misses;
  return misses;
}

void TextureCache::Drop(uint64_t line) {
  const auto first = lines_.begin() + static_cast<ptrdiff_t>(line % sets() * options_.ways);
  const auto end = first + options_.ways;
  const auto found = std::find(first, end, line);
  if (found == end) return;
  std::move(found + 1, end, found);
  *(end - 1) = kNoLine;
}

void TextureCache::Invalidate(uint64_t begin, uint64_t end) {
  if (begin >= end) return;
  const uint64_t first = begin / options_.line, last = (end - 1) / options_.line;
  if (last - first < lines_.size()) {
    for (uint64_t line = first; line <= last; ++line) Drop(line);
    return;
  }
  for (auto set = lines_.begin(); set != lines_.end(); set += options_.ways) {
    const auto kept = std::remove_if(set, set + options_.ways,
                                     [&](uint64_t line) { return line >= first && line <= last; });
    std::fill(kept, set + options_.ways, kNoLine);
  }
}

void TextureCache::Clear() { std::fill(lines_.begin(), lines_.end(), kNoLine); }

}  // namespace quarry::laboratory
