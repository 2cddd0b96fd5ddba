#include "common/protocol/messages.h"
#include "messages_generated.h"

namespace quarry {
namespace {

template <class Table>
Bytes Pack(const typename Table::NativeTableType& native) {
  flatbuffers::FlatBufferBuilder builder(256);
  builder.Finish(Table::Pack(builder, &native));
  const auto* data = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  return Bytes(data, data + builder.GetSize());
}

template <class V>
auto ToVector(const V& v) {
  return std::vector<typename V::value_type>{v.x, v.y, v.z};
}

wire::JobT JobToWire(const RenderJob& job) {
  wire::JobT w;
  w.width = job.width;
  w.height = job.height;
  w.crop = {job.crop_x, job.crop_y, job.crop_width, job.crop_height};
  w.mode = static_cast<uint8_t>(job.mode);
  w.spp = job.spp;
  w.seed = job.seed;
  w.exposure = job.exposure;
  w.aov_mask = job.aov_mask;
  w.format = job.format;
  w.ambient = ToVector(job.ambient);
  w.background = ToVector(job.background);
  w.first_frame = job.first_frame;
  for (const Light& light : job.lights) {
    auto l = std::make_unique<wire::LightT>();
    l->kind = static_cast<uint8_t>(light.kind);
    l->vector = ToVector(light.vector);
    l->radiance = ToVector(light.radiance);
    l->axis = ToVector(light.axis);
    l->cone_scale = light.cone_scale;
    l->cone_offset = light.cone_offset;
    w.lights.push_back(std::move(l));
  }
  for (const CameraSpec& camera : job.cameras) {
    auto c = std::make_unique<wire::CameraT>();
    c->eye = ToVector(camera.eye);
    c->at = ToVector(camera.at);
    c->up = ToVector(camera.up);
    c->fov_degrees = camera.fov_degrees;
    c->ortho_height = camera.ortho_height;
    w.cameras.push_back(std::move(c));
  }
  return w;
}

}  // namespace

Bytes Encode(const Hello& m) {
  wire::HelloT w;
  w.role = static_cast<uint8_t>(m.role);
  w.name = m.name;
  w.threads = m.threads;
  w.instance = m.instance;
  w.serves_at = m.serves_at;
  return Pack<wire::Hello>(w);
}

Bytes Encode(const Welcome& m) {
  wire::WelcomeT w;
  w.scene_id.assign(m.scene_id.begin(), m.scene_id.end());
  w.worker = m.worker;
  w.sources = m.sources;
  return Pack<wire::Welcome>(w);
}

Bytes Encode(const Failure& m) {
  wire::FailureT w;
  w.message = m.message;
  return Pack<wire::Failure>(w);
}

Bytes Encode(const JobRequest& m) {
  wire::JobRequestT w;
  w.job = std::make_unique<wire::JobT>(JobToWire(m.job));
  w.have = m.have;
  return Pack<wire::JobRequest>(w);
}

Bytes Encode(const FrameProgress& m) {
  wire::FrameProgressT w;
  w.frame = m.frame;
  w.tiles_done = m.tiles_done;
  w.tiles = m.tiles;
  w.workers = m.workers;
  return Pack<wire::FrameProgress>(w);
}

Bytes Encode(const FrameDone& m) {
  wire::FrameDoneT w;
  w.frame = m.frame;
  w.statistics = m.statistics;
  return Pack<wire::FrameDone>(w);
}

Bytes Encode(const FrameSetup& m) {
  wire::FrameSetupT w;
  w.setup = m.setup;
  w.oldest = m.oldest;
  w.job = std::make_unique<wire::JobT>(JobToWire(m.job));
  return Pack<wire::FrameSetup>(w);
}

Bytes Encode(const TileOrder& m) {
  wire::TileOrderT w;
  w.setup = m.setup;
  w.tile = m.tile;
  w.lease = m.lease;
  w.x = m.x;
  w.y = m.y;
  w.width = m.width;
  w.height = m.height;
  w.blocks = m.blocks;
  w.holders = m.holders;
  return Pack<wire::TileOrder>(w);
}

Bytes Encode(const TileDone& m) {
  wire::TileDoneT w;
  w.setup = m.setup;
  w.tile = m.tile;
  w.lease = m.lease;
  w.rays = m.rays;
  w.rays_suspended = m.rays_suspended;
  w.compute_us = m.compute_us;
  w.depths = m.depths;
  w.blocks = m.blocks;
  return Pack<wire::TileDone>(w);
}

Bytes Encode(const Peers& m) {
  wire::PeersT w;
  w.workers = m.workers;
  w.endpoints = m.endpoints;
  return Pack<wire::Peers>(w);
}

Bytes Encode(const WorkerStatus& m) {
  wire::WorkerStatusT w;
  w.cache_bytes = m.cache_bytes;
  w.voxels_loaded = m.voxels_loaded;
  w.voxel_bytes_loaded = m.voxel_bytes_loaded;
  w.voxel_bytes_received = m.voxel_bytes_received;
  w.evictions = m.evictions;
  w.rays = m.rays;
  w.rays_suspended = m.rays_suspended;
  w.peak_rss_bytes = m.peak_rss_bytes;
  w.whole = m.whole;
  w.cached = m.cached;
  w.dropped = m.dropped;
  w.bytes_from.assign(m.bytes_from.begin(), m.bytes_from.end());
  w.retries = m.retries;
  w.hedges = m.hedges;
  w.damaged = m.damaged;
  w.stall_us = m.stall_us;
  w.compute_us = m.compute_us;
  w.fetch_us = m.fetch_us;
  w.prefetched_bytes = m.prefetched_bytes;
  w.prefetch_wasted_bytes = m.prefetch_wasted_bytes;
  w.decode_us = m.decode_us;
  w.tiles_wanted = m.tiles_wanted;
  return Pack<wire::WorkerStatus>(w);
}

Bytes Encode(const BlockRequest& m) {
  wire::BlockRequestT w;
  w.block = m.block;
  return Pack<wire::BlockRequest>(w);
}

}  // namespace quarry
