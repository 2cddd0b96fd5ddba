#include "preprocess/texture/mip_builder.h"

#include <algorithm>
#include <cstring>

#include "common/base/check.h"
#include "preprocess/texture/texel_codes.h"

namespace quarry {

MipBuilder::MipBuilder(const TexelLayout& layout, Emit emit)
    : layout_(layout),
      shape_(layout.width, layout.height),
      emit_(std::move(emit)),
      levels_(shape_.levels().size()) {
  for (uint32_t l = 0; l < levels_.size(); ++l) {
    const TextureShape::Level& level = shape_.levels()[l];
    if (l < shape_.tail())
      levels_[l].strip.resize(size_t{std::min(level.height, kPageSide)} * level.width * layout.texel_bytes());
    levels_[l].mean.resize(size_t{std::max(level.width / 2, 1u)} * layout.channels);
  }
  tail_.resize(size_t{shape_.TexelsOf(shape_.pages() - 1)} * layout.texel_bytes());
}

Status MipBuilder::AddRow(std::span<const std::byte> texels) {
  QUARRY_CHECK(texels.size() == size_t{layout_.width} * layout_.texel_bytes());
  const uint32_t row = levels_[0].row;
  QUARRY_TRY(Store(0, texels));
  if (levels_.size() == 1) return {};
  ToLinear(texels, layout_, linear_);
  return PassOn(0, row, linear_);
}

/// Stores a row of a level and emits the pages that it completes.
Status MipBuilder::Store(uint32_t l, std::span<const std::byte> texels) {
  const TextureShape::Level& level = shape_.levels()[l];
  const uint32_t row = levels_[l].row++;
  QUARRY_CHECK(row < level.height);
  if (l >= shape_.tail()) {
    const size_t at = (shape_.TailOffset(l) + size_t{row} * level.width) * layout_.texel_bytes();
    std::ranges::copy(texels, tail_.begin() + static_cast<ptrdiff_t>(at));
    tail_filled_ += texels.size();
    return tail_filled_ == tail_.size() ? emit_(shape_.pages() - 1, tail_) : Status{};
  }
  std::ranges::copy(texels,
                    levels_[l].strip.begin() + static_cast<ptrdiff_t>(row % kPageSide * texels.size()));
  return row % kPageSide == kPageSide - 1 || row + 1 == level.height ? EmitStrip(l) : Status{};
}

Status MipBuilder::EmitStrip(uint32_t l) {
  const TextureShape::Level& level = shape_.levels()[l];
  const uint32_t page_row = (levels_[l].row - 1) / kPageSide;
  for (uint32_t column = 0; column < level.columns; ++column) {
    const uint32_t page = shape_.PageOf(l, column, page_row);
    const TextureShape::Part part = shape_.PartOf(page);
    const size_t bytes = size_t{part.width} * layout_.texel_bytes();
    page_.resize(bytes * part.height);
    for (uint32_t y = 0; y < part.height; ++y)
      std::memcpy(&page_[y * bytes],
                  &levels_[l].strip[(size_t{y} * level.width + part.x) * layout_.texel_bytes()], bytes);
    QUARRY_TRY(emit_(page, page_));
  }
  return {};
}

/// Adds row `row` of level `l` to the rows of the next level that cover it. Of an odd height h = 2n + 1, row
/// i of the next level covers (n - i) / h of row 2i, n / h of row 2i + 1 and (i + 1) / h of row 2i + 2.
Status MipBuilder::PassOn(uint32_t l, uint32_t row, const std::vector<float>& linear) {
  const uint32_t height = shape_.levels()[l].height, n = height / 2;
  std::vector<float>& half = levels_[l].half;
  Halve(linear, shape_.levels()[l].width, half);
  std::vector<float>& mean = levels_[l].mean;
  const auto add = [&](float weight) {
    for (size_t i = 0; i < mean.size(); ++i) mean[i] += weight * half[i];
  };
  const auto done = [&]() -> Status {
    Status added = AddLinear(l + 1, mean);
    std::ranges::fill(mean, 0.0f);
    return added;
  };
  const auto h = static_cast<float>(height);
  if (height == 1) {
    add(1);
    return done();
  }
  if (height % 2 == 0) {
    add(0.5f);
    return row % 2 == 1 ? done() : Status{};
  }
  const uint32_t i = row / 2;
  if (row % 2 == 1) {
    add(static_cast<float>(n) / h);
    return {};
  }
  if (i > 0) {
    add(static_cast<float>(i) / h);
    QUARRY_TRY(done());
  }
  if (i < n) add(static_cast<float>(n - i) / h);
  return {};
}

Status MipBuilder::AddLinear(uint32_t l, const std::vector<float>& linear) {
  FromLinear(linear, layout_, texels_);
  const uint32_t row = levels_[l].row;
  QUARRY_TRY(Store(l, texels_));
  return l + 1 < levels_.size() ? PassOn(l, row, linear) : Status{};
}

namespace {

template <uint32_t kChannels>
void HalveRow(const float* in, uint32_t width, float* out) {
  const uint32_t n = width / 2;
  if (width % 2 == 0) {
    for (uint32_t i = 0; i < n; ++i, in += 2 * kChannels, out += kChannels)
      for (uint32_t c = 0; c < kChannels; ++c) out[c] = 0.5f * (in[c] + in[kChannels + c]);
    return;
  }
  const auto w = static_cast<float>(width);
  for (uint32_t i = 0; i < n; ++i, in += 2 * kChannels, out += kChannels)
    for (uint32_t c = 0; c < kChannels; ++c)
      out[c] = (static_cast<float>(n - i) * in[c] + static_cast<float>(n) * in[kChannels + c] +
                static_cast<float>(i + 1) * in[2 * kChannels + c]) /
               w;
}

}  // namespace

void MipBuilder::Halve(const std::vector<float>& wide, uint32_t width, std::vector<float>& out) const {
  if (width == 1) {
    out = wide;
    return;
  }
  out.resize(size_t{width / 2} * layout_.channels);
  constexpr decltype(&HalveRow<1>) kHalve[] = {HalveRow<1>, HalveRow<2>, HalveRow<3>, HalveRow<4>};
  kHalve[layout_.channels - 1](wide.data(), width, out.data());
}

}  // namespace quarry
