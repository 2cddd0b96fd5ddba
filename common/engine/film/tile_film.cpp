#include "common/engine/film/tile_film.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

#include "common/engine/film/mean_color.h"
#include "common/kdtree/locate.h"
#include "common/math/shared_exponent.h"

namespace quarry {
namespace {

constexpr uint32_t kNone = 0xFFFFFFFFu;  // value of integer layers where nothing is hit

}  // namespace

void TileFilm::Open(const ViewContext& view, const Tile& tile) {
  tile_ = tile;
  const size_t pixels = size_t{tile.columns()} * tile.rows();
  depths_.assign(size_t{DepthCells(tile.columns())} * DepthCells(tile.rows()), 0);
  stride_ = SumWords(view.view.aov_mask);
  sums_.assign(stride_ * pixels, {});
  aovs_.assign((view.words - kColorWords) * pixels, 0);
  hits_ = {};
  surfaces_ = {};
  counts_ = {};
  faults_ = {};
  edges_.Open(tile, view.view.edges && !tile.leaves_holes);
  holes_.assign(tile.leaves_holes ? pixels : 0, false);
}

void TileFilm::OpenHits(size_t count, RayGoal goal, bool has_surfaces) {
  tile_ = {};
  depths_.clear();
  sums_.clear();
  stride_ = kColorWords;
  aovs_.clear();
  holes_.clear();
  edges_.Open({}, false);
  const bool one_each = goal == RayGoal::kNearest || goal == RayGoal::kAny;
  keeps_all_ = goal == RayGoal::kAll;
  hits_.assign(one_each ? count : 0, {});
  surfaces_.assign(one_each && has_surfaces ? count : 0, {});
  counts_.assign(one_each ? 0 : count, 0);
  ray_of_hit_.clear();
}

/// Puts all hits in the order of their rays. Those of one ray have come in their order.
void TileFilm::SortHits() {
  std::vector<uint32_t> next(counts_.size());
  std::exclusive_scan(counts_.begin(), counts_.end(), next.begin(), 0u);
  std::vector<Hit> hits(hits_.size());
  std::vector<HitSurface> surfaces(surfaces_.size());
  for (size_t i = 0; i < hits_.size(); ++i) {
    const uint32_t place = next[ray_of_hit_[i]]++;
    hits[place] = hits_[i];
    if (!surfaces.empty()) surfaces[place] = surfaces_[i];
  }
  hits_ = std::move(hits);
  surfaces_ = std::move(surfaces);
}

void TileFilm::NoteFault(const glm::vec3& radiance) {
  for (const float term : {radiance.x, radiance.y, radiance.z}) {
    faults_.not_numbers += std::isnan(term);
    faults_.saturated += term >= FixedRadiance::kMost;
  }
}

void TileFilm::SetLayers(const ViewContext& context, uint32_t pixel, const Ray& ray, const Hit& hit,
                         float t_offset, const Surface& surface, const glm::vec3& albedo) {
  const View& view = context.view;
  uint32_t* out = aovs_.data() + size_t{context.words - kColorWords} * pixel;
  const bool is_hit = hit.triangle != kNoTriangle;
  const auto put = [&](Aov aov, auto... values) {
    if (view.has(aov)) ((*out++ = std::bit_cast<uint32_t>(values)), ...);
  };
  put(Aov::kDepth, is_hit ? t_offset + hit.t : kInfinity);
  put(Aov::kNormal, surface.normal.x, surface.normal.y, surface.normal.z);
  put(Aov::kUv, surface.uv.x, surface.uv.y);
  put(Aov::kPrimitive, is_hit ? hit.triangle : kNone);
  put(Aov::kMaterial, is_hit ? surface.material : kNone);
  put(Aov::kPart, is_hit ? surface.part : kNone);
  put(Aov::kVoxel,
      is_hit && view.has(Aov::kVoxel) ? LocateVoxel(context.catalog.top_tree(), ray, hit.t) : kNone);
  put(Aov::kAlbedo, albedo.x, albedo.y, albedo.z);
  put(Aov::kNoise, 0.0f);
  put(Aov::kSamples, 0u);
}

void TileFilm::AddAverages(const ViewContext& context, uint32_t pixel, bool is_hit, const glm::vec3& normal,
                           const glm::vec3& albedo) {
  FixedRadiance* to = &sums_[size_t{stride_} * pixel + kColorWords];
  const auto add = [&](Aov aov, const glm::vec3& value) {
    if (!context.view.has(aov)) return;
    for (int c = 0; c < 3; ++c) (to++)->Add(value[c]);
  };
  add(Aov::kNormal, glm::vec3(1) + (is_hit ? normal : glm::vec3(0)));
  add(Aov::kAlbedo, albedo);
}

void TileFilm::Take(const ViewContext& view, RenderedTile& result) {
  if (tile_.form == PixelForm::kMeans) PutMeans(view, result.pixels);
  if (tile_.form == PixelForm::kSums) PutSums(view, result.pixels);
  if (tile_.form == PixelForm::kShown) PutShown(view, result.pixels);
  result.holes = static_cast<uint32_t>(std::ranges::count(holes_, true));
  if (keeps_all_) SortHits();
  keeps_all_ = false;
  result.hits = std::exchange(hits_, {});
  result.surfaces = std::exchange(surfaces_, {});
  result.counts = std::exchange(counts_, {});
  result.faults = faults_;
  result.depths = std::exchange(depths_, {});
}

void TileFilm::PutMeans(const ViewContext& context, Bytes& out) const {
  const size_t pixels = sums_.size() / stride_, extra = context.words - kColorWords;
  out.resize(pixels * context.words * 4);
  std::byte* to = out.data();
  const MeanColor mean(context.view.spp, context.view.range);
  for (size_t p = 0; p < pixels; ++p) {
    const auto color = mean(&sums_[stride_ * p]);
    std::memcpy(to, color.data(), sizeof color);
    if (extra > 0)  // without layers aovs_ is empty
      std::memcpy(to + sizeof color, aovs_.data() + p * extra, extra * 4);
    if (stride_ > kColorWords)
      PutAverages(&sums_[stride_ * p], context.view.spp, context.view.aov_mask, to + sizeof color);
    to += context.words * 4;
  }
}

void TileFilm::PutSums(const ViewContext& context, Bytes& out) const {
  const size_t pixels = sums_.size() / stride_, extra = context.words - kColorWords;
  out.resize(pixels * (stride_ * sizeof(int64_t) + extra * 4));
  std::byte* to = out.data();
  for (size_t p = 0; p < pixels; ++p) {
    for (size_t c = 0; c < stride_; ++c, to += sizeof(int64_t)) {
      const int64_t sum = sums_[stride_ * p + c].bits();
      std::memcpy(to, &sum, sizeof sum);
    }
    if (extra > 0) std::memcpy(to, aovs_.data() + p * extra, extra * 4);
    to += extra * 4;
  }
}

void TileFilm::PutShown(const ViewContext& context, Bytes& out) const {
  const size_t pixels = sums_.size() / stride_;
  const uint32_t samples = tile_.samples_of(context.view.spp);
  out.resize(pixels * sizeof(uint32_t));
  for (size_t p = 0; p < pixels; ++p) {
    const FixedRadiance* of = &sums_[stride_ * p];
    const bool hole = !holes_.empty() && holes_[p];
    const uint32_t code = hole ? kHole
                          : of[3].bits() == 0
                              ? kUncovered
                              : PackShared({of[0].Mean(samples), of[1].Mean(samples), of[2].Mean(samples)});
    std::memcpy(out.data() + p * sizeof code, &code, sizeof code);
  }
}

}  // namespace quarry
