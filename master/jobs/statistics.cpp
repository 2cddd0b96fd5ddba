#include "master/jobs/statistics.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "common/base/resource.h"

namespace quarry {

nlohmann::ordered_json WorkerStatistics(const WorkerRecord& w) {
  static const char* const kinds[kSourceKinds] = {"file", "tcp", "http", "peer", "disk", "memory"};
  const WorkerStatus& c = w.counters;
  nlohmann::ordered_json j;
  j["name"] = w.name;
  j["threads"] = w.threads;
  j["tiles"] = w.tiles;
  j["cache_bytes"] = c.cache_bytes;
  j["voxel_blocks_loaded"] = c.voxels_loaded;
  j["voxel_bytes_loaded"] = c.voxel_bytes_loaded;
  j["voxel_bytes_received"] = c.voxel_bytes_received;
  for (size_t k = 0; k < kSourceKinds; ++k) j[fmt::format("voxel_bytes_from_{}", kinds[k])] = c.bytes_from[k];
  j["evictions"] = c.evictions;
  j["rays"] = c.rays;
  j["rays_suspended"] = c.rays_suspended;
  j["fetch_s"] = static_cast<double>(c.fetch_us) * 1e-6;
  j["decode_s"] = static_cast<double>(c.decode_us) * 1e-6;
  j["compute_s"] = static_cast<double>(c.compute_us) * 1e-6;
  j["stall_s"] = static_cast<double>(c.stall_us) * 1e-6;
  j["source_retries"] = c.retries;
  j["source_hedges"] = c.hedges;
  j["blocks_damaged"] = c.damaged;
  j["prefetched_bytes"] = c.prefetched_bytes;
  j["prefetch_wasted_bytes"] = c.prefetch_wasted_bytes;
  j["peak_rss_bytes"] = c.peak_rss_bytes;
  return j;
}

std::string FrameStatistics(const ActiveFrame& frame, const FrameTimes& times,
                            const WorkerRegistry& registry) {
  nlohmann::ordered_json j;
  j["frame"] = times.number;
  j["frame_wall_s"] = times.end_s - times.start_s;
  j["frame_start_s"] = times.start_s;
  j["first_tile_s"] = frame.counts().first_tile_s - times.start_s;
  j["tiles"] = frame.image().tiles().size();
  j["rays"] = frame.counts().rays;
  j["rays_suspended"] = frame.counts().rays_suspended;
  j["leases_lost"] = frame.counts().leases_lost;
  if (const NoiseBlocks* noise = frame.noise()) {
    j["noise"] = noise->largest_error();
    j["mean_samples"] = noise->mean_samples();
  }
  j["saturated_terms"] = frame.counts().saturated;
  j["nan_terms"] = frame.counts().not_numbers;
  j["long_light_rays"] = frame.counts().long_light_rays;
  j["voxel_bytes_served"] = times.voxel_bytes_served;
  j["master_peak_rss_bytes"] = PeakResidentBytes();
  j["workers"] = nlohmann::ordered_json::array();
  for (const auto& [id, worker] : registry.all()) j["workers"].push_back(WorkerStatistics(worker));
  return j.dump();
}

std::string WithExposure(const std::string& statistics, double ev) {
  auto j = nlohmann::ordered_json::parse(statistics);
  j["exposure_ev"] = ev;
  return j.dump();
}

std::string ProgressLine(const ActiveFrame& frame, uint32_t number, const WorkerRegistry& registry) {
  WorkerStatus sum;
  for (const auto& [id, w] : registry.all()) {
    sum.rays += w.counters.rays;
    sum.voxel_bytes_received += w.counters.voxel_bytes_received;
    sum.stall_us += w.counters.stall_us;
    sum.compute_us += w.counters.compute_us;
  }
  return fmt::format(
      "frame {}: {} of {} tiles; {} workers, {:.1f} million rays, {:.1f} MB of voxels received, {:.1f} s of "
      "computing, {:.1f} s of waiting so far",
      number, frame.tiles_done(), frame.image().tiles().size(), registry.all().size(),
      static_cast<double>(sum.rays) * 1e-6, static_cast<double>(sum.voxel_bytes_received) * 1e-6,
      static_cast<double>(sum.compute_us) * 1e-6, static_cast<double>(sum.stall_us) * 1e-6);
}

}  // namespace quarry
