#include "common/engine/sources/edge_rays.h"

#include <algorithm>

namespace quarry {

void EdgeRays::Open(const View& view, const Camera& camera, const Tile& tile) {
  view_ = &view;
  camera_ = &camera;
  tile_ = tile;
  grid_ = EdgeGrid(tile);
  next_ = 0;
}

RaySource::Lanes EdgeRays::Next(uint64_t /*free*/, SamplePacket& s, RayPacket& rays) {
  const uint32_t count = std::min(RayPacket::kRays, grid_.size() - next_);
  s.BeginPaths();
  std::fill_n(s.sample, RayPacket::kRays, 0u);
  std::fill_n(s.depth_cell, RayPacket::kRays, uint16_t{0});
  double x[RayPacket::kRays] = {}, y[RayPacket::kRays] = {};
  for (uint32_t i = 0; i < count; ++i) {
    const uint32_t place = next_ + i;
    int64_t column = 0, row = 0;
    grid_.PixelOf(tile_, place, column, row);
    x[i] = static_cast<double>(column) + 0.5;
    y[i] = static_cast<double>(row) + 0.5;
    // Of a pixel outside of the image another one's number: it decides only whether a thin cut-out is hit.
    s.image_pixel[i] = static_cast<uint32_t>(row) * view_->width + static_cast<uint32_t>(column);
    s.pixel[i] = static_cast<uint16_t>(place);
    s.depth[i] = static_cast<uint8_t>(place >> 16);
  }
  next_ += count;
  camera_->Shoot(x, y, primary_);
  rays.SetAll(primary_.origin, primary_.direction);
  std::copy_n(primary_.t_offset, RayPacket::kRays, s.t_offset);
  Lanes lanes;
  for (uint32_t i = 0; i < count; ++i)
    (primary_.misses[i] ? lanes.missing_box : lanes.in_box) |= uint64_t{1} << i;
  return lanes;
}

}  // namespace quarry
