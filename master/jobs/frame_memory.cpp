#include "master/jobs/frame_memory.h"

#include <fmt/format.h>

#include "common/base/size.h"
#include "master/jobs/job.h"
#include "master/pictures/image_output.h"
#include "master/schedule/tile_ranges.h"

namespace quarry {
namespace {

/// Bytes of a tile's records: place, worker, expected and shown footprint.
constexpr uint64_t kTileBytes = 1 << 10;
/// Bytes of a frame of any size: the encoder, and footprints (ActiveFrame keeps 2^21 block numbers at most,
/// and as many expected ones with a chance each).
constexpr uint64_t kFrameBytes = 1 << 20, kMostTraceBytes = 24 << 20;
constexpr uint64_t kTraceBytesPerTile = 16 << 10;

/// Of sums of tiles that have a part of their samples. With noise, all tiles have sums, the last stop's too,
/// and layers, which take no more than the encoded image that is not there yet.
uint64_t SumsBytes(const View& view, uint64_t tiles) {
  const uint64_t of_tile = SumWords(view.aov_mask) * TileRanges::kWordBytes;
  if (NoiseBlocks::Needs(view)) return 2 * tiles * of_tile;
  return view.spp == 1 ? 0 : std::min<uint64_t>(tiles, TileRanges::kMostBegun) * of_tile;
}

uint64_t Pixels(const View& view) { return uint64_t{view.crop.width} * view.crop.height; }

}  // namespace

uint64_t FrameBytes(const View& view, const ImageFormat& format) {
  const uint64_t tiles = uint64_t{(view.crop.width + kTileSize - 1) / kTileSize} *
                         ((view.crop.height + kTileSize - 1) / kTileSize);
  return Pixels(view) * 4 * WordsPerPixel(view.aov_mask) + 2 * EncodedBytes(view, format) +
         tiles * kTileBytes + std::min(tiles * kTraceBytesPerTile, kMostTraceBytes) + kFrameBytes +
         SumsBytes(view, tiles);
}

uint64_t JobBytes(size_t frames) {
  return (64 << 10) + frames * (sizeof(CameraSpec) + sizeof(Job::Finished) + sizeof(Job::FrameState));
}

Status FrameMemory::CheckJob(const RenderJob& job, uint64_t jobs_bytes) const {
  const uint64_t frame = FrameBytes(job.view, job.format), own = JobBytes(job.cameras.size());
  if (frame > for_frames())
    return Fail(
        fmt::format("a picture of {}x{} takes {} of the master's memory, and it has {} for pictures "
                    "(quarry-master --frame-memory); render a smaller one, or parts of it with --crop",
                    job.view.crop.width, job.view.crop.height, FormatSize(frame), FormatSize(for_frames())));
  if (jobs_bytes + own > for_jobs())
    return Fail(
        fmt::format("a job of {0} frames takes {1} of the master's memory, and {3} of its {2} for jobs are "
                    "in use (quarry-master --frame-memory); ask for fewer frames, or try later",
                    job.cameras.size(), FormatSize(own), FormatSize(for_jobs()), FormatSize(jobs_bytes)));
  return {};
}

FrameMemory::Reservation FrameMemory::Take(uint64_t bytes) {
  *used_ += bytes;
  return {new uint64_t(bytes), [used = used_](const uint64_t* taken) {
            *used -= *taken;
            delete taken;
          }};
}

}  // namespace quarry
