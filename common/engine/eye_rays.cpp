#include "common/engine/eye_rays.h"

#include <algorithm>

#include "common/math/sampling.h"

namespace quarry {

void EyeRayGenerator::Open(const ViewContext& view, const Tile& tile) {
  tile_ = tile;
  constexpr uint32_t kSide = RayPacket::kSide;
  places_.clear();
  for (uint32_t y0 = 0; y0 < tile_.rows(); y0 += kSide)
    for (uint32_t x0 = 0; x0 < tile_.columns(); x0 += kSide)
      for (uint32_t y = y0; y < std::min(y0 + kSide, tile_.rows()); ++y)
        for (uint32_t x = x0; x < std::min(x0 + kSide, tile_.columns()); ++x)
          places_.push_back({static_cast<uint16_t>(y * tile_.columns() + x), static_cast<uint8_t>(x),
                             static_cast<uint8_t>(y)});
  count_ = places_.size() * uint64_t{tile.samples_of(view.view.spp)};
  next_ = 0;
}

EyeRayGenerator::Lanes EyeRayGenerator::Next(const ViewContext& context, SamplePacket& s, RayPacket& rays,
                                             PrimaryRays& primary) {
  const View& view = context.view;
  const auto count = static_cast<uint32_t>(std::min<uint64_t>(RayPacket::kRays, count_ - next_));
  auto sample = tile_.first_sample + static_cast<uint32_t>(next_ / places_.size());
  auto place = static_cast<uint32_t>(next_ % places_.size());
  const uint32_t across = DepthCells(tile_.columns());
  double x[RayPacket::kRays] = {}, y[RayPacket::kRays] = {};
  for (uint32_t i = 0; i < count; ++i) {
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
  next_ += count;
  context.camera.Shoot(x, y, primary);
  rays.SetAll(primary.origin, primary.direction);
  std::copy_n(primary.t_offset, RayPacket::kRays, s.t_offset);
  std::fill_n(s.weight.x, RayPacket::kRays, 1.0f);
  std::fill_n(s.weight.y, RayPacket::kRays, 1.0f);
  std::fill_n(s.weight.z, RayPacket::kRays, 1.0f);
  std::fill_n(s.path_code, RayPacket::kRays, kPrimaryPath);
  std::fill_n(s.depth, RayPacket::kRays, 0);
  std::fill_n(s.pending_count, RayPacket::kRays, 0);
  Lanes lanes;
  for (uint32_t i = 0; i < count; ++i)
    (primary.misses[i] ? lanes.missing_box : lanes.in_box) |= uint64_t{1} << i;
  return lanes;
}

}  // namespace quarry
