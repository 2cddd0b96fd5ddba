#include "common/engine/sources/eye_rays.h"

#include <algorithm>

#include "common/engine/rays/lanes.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

/// Of a sample's place on the lens: vertices of paths leave it free.
constexpr uint32_t kLensDimension = 14;
static_assert(kLensDimension + 2 <= kDimensionsPerBounce);

}  // namespace

void EyeRays::Open(const View& view, const Camera& camera, const Tile& tile) {
  view_ = &view;
  camera_ = &camera;
  tile_ = tile;
  constexpr uint32_t kSide = RayPacket::kSide;
  places_.clear();
  for (uint32_t y0 = 0; y0 < tile_.rows(); y0 += kSide)
    for (uint32_t x0 = 0; x0 < tile_.columns(); x0 += kSide)
      for (uint32_t y = y0; y < std::min(y0 + kSide, tile_.rows()); ++y)
        for (uint32_t x = x0; x < std::min(x0 + kSide, tile_.columns()); ++x)
          places_.push_back({static_cast<uint16_t>(y * tile_.columns() + x), static_cast<uint8_t>(x),
                             static_cast<uint8_t>(y)});
  count_ = places_.size() * uint64_t{tile.samples_of(view.spp)};
  next_ = 0;
}

/// Takes one of the rays that the camera has shot, beside rays that are under way.
void EyeRays::SetLane(uint32_t lane, SamplePacket& s, RayPacket& rays) const {
  Ray ray;
  for (int axis = 0; axis < 3; ++axis) {
    ray.origin[axis] = primary_.origin[axis][lane];
    ray.direction[axis] = primary_.direction[axis][lane];
  }
  rays.Set(lane, ray);
  s.t_offset[lane] = primary_.t_offset[lane];
  s.BeginPath(lane);
}

/// Lets the rays of `lanes` start anywhere on the lens.
void EyeRays::MoveToLens(uint64_t lanes, const SamplePacket& s, const double* x, const double* y) {
  ForEachLane(lanes, [&](uint32_t i) {
    const glm::vec2 u = SobolSample(view_->seed, s.image_pixel[i], s.sample[i], kLensDimension);
    const glm::vec2 place = ConcentricDisk(u);
    const PrimaryRay ray =
        camera_->ShootThrough(x[i], y[i], static_cast<double>(place.x), static_cast<double>(place.y));
    for (int axis = 0; axis < 3; ++axis) {
      primary_.origin[axis][i] = ray.origin[axis];
      primary_.direction[axis][i] = ray.direction[axis];
    }
    primary_.t_offset[i] = ray.t_offset;
    primary_.misses[i] = ray.misses;
  });
}

RaySource::Lanes EyeRays::Next(uint64_t free, SamplePacket& s, RayPacket& rays) {
  const View& view = *view_;
  uint64_t begun = 0;
  auto sample = tile_.first_sample + static_cast<uint32_t>(next_ / places_.size());
  auto place = static_cast<uint32_t>(next_ % places_.size());
  const uint32_t across = DepthCells(tile_.columns());
  double x[RayPacket::kRays] = {}, y[RayPacket::kRays] = {};
  for (uint32_t i = 0; i < RayPacket::kRays && next_ < count_; ++i) {
    if ((free >> i & 1) == 0) continue;
    begun |= uint64_t{1} << i;
    ++next_;
    const Place& p = places_[place];
    const uint32_t px = tile_.X(p.x), py = tile_.Y(p.y);
    const glm::vec2 at = PixelSample(view.seed, s.image_pixel[i] = py * view.width + px, sample);
    x[i] = px + static_cast<double>(at.x);
    y[i] = py + static_cast<double>(at.y);
    s.pixel[i] = p.pixel;
    s.depth_cell[i] = static_cast<uint16_t>(p.y / kDepthCell * across + p.x / kDepthCell);
    s.sample[i] = sample;
    if (++place == places_.size()) {
      place = 0;
      ++sample;
    }
  }
  camera_->Shoot(x, y, primary_);
  if (camera_->has_lens()) MoveToLens(begun, s, x, y);
  if (~free == 0) {
    rays.SetAll(primary_.origin, primary_.direction);
    std::copy_n(primary_.t_offset, RayPacket::kRays, s.t_offset);
    s.BeginPaths();
  }
  Lanes lanes;
  for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
    if ((begun >> i & 1) == 0) continue;
    if (~free != 0) SetLane(i, s, rays);
    (primary_.misses[i] ? lanes.missing_box : lanes.in_box) |= uint64_t{1} << i;
  }
  return lanes;
}

}  // namespace quarry
