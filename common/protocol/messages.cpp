#include "common/protocol/messages.h"

#include <flatbuffers/util.h>

#include <algorithm>

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

template <class Table>
Result<typename Table::NativeTableType> Unpack(std::span<const std::byte> bytes) {
  flatbuffers::Verifier verifier(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size(), 16,
                                 kMaxFrames * 8);
  if (bytes.size() < 8 || !verifier.VerifyBuffer<Table>(nullptr))
    return Fail("received a message that is not well formed");
  typename Table::NativeTableType native;
  flatbuffers::GetRoot<Table>(bytes.data())->UnPackTo(&native);
  return native;
}

template <class V>
auto ToVector(const V& v) {
  return std::vector<typename V::value_type>{v.x, v.y, v.z};
}

template <class V>
bool FromVector(const std::vector<typename V::value_type>& values, V& v) {
  if (values.size() != 3) return false;
  v = V(values[0], values[1], values[2]);
  return true;
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

Result<RenderJob> JobFromWire(const wire::JobT& w) {
  RenderJob job;
  bool ok =
      w.crop.size() == 4 && FromVector(w.ambient, job.ambient) && FromVector(w.background, job.background);
  if (ok) {
    job.crop_x = w.crop[0];
    job.crop_y = w.crop[1];
    job.crop_width = w.crop[2];
    job.crop_height = w.crop[3];
  }
  job.width = w.width;
  job.height = w.height;
  job.mode = static_cast<RenderMode>(w.mode);
  job.spp = w.spp;
  job.seed = w.seed;
  job.exposure = w.exposure;
  job.aov_mask = w.aov_mask;
  job.format = w.format;
  job.first_frame = w.first_frame;
  for (const auto& l : w.lights) {
    Light light;
    ok = ok && l->kind <= 1 && FromVector(l->vector, light.vector) && FromVector(l->radiance, light.radiance);
    light.kind = static_cast<LightKind>(l->kind);
    job.lights.push_back(light);
  }
  for (const auto& c : w.cameras) {
    CameraSpec camera;
    ok = ok && FromVector(c->eye, camera.eye) && FromVector(c->at, camera.at) && FromVector(c->up, camera.up);
    camera.fov_degrees = c->fov_degrees;
    camera.ortho_height = c->ortho_height;
    job.cameras.push_back(camera);
  }
  if (!ok) return Fail("received a render job that is not well formed");
  QUARRY_TRY(NormalizeJob(job));
  return job;
}

/// What another program says is printed, and written as JSON: UTF-8 that moves no cursor.
std::string Legible(const std::string& text) {
  std::string legible;
  const char* at = text.c_str();
  while (at < text.c_str() + text.size()) {
    const char* next = at;
    const int code = flatbuffers::FromUTF8(&next);  // a sequence that is none, or cut off, is -1
    if (code < ' ' || (code >= 0x7f && code < 0xa0)) {
      legible += '?';
      ++at;
    } else {
      legible.append(at, next);
      at = next;
    }
  }
  return legible;
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

Result<Hello> DecodeHello(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::Hello>(table));
  const bool idle = static_cast<Role>(w.role) == Role::kWorker && w.threads == 0;
  if (w.role > 2 || w.name.size() > 256 || w.threads > 4096 || idle)
    return Fail("received a greeting that is not well formed");
  return Hello{static_cast<Role>(w.role), Legible(w.name), w.threads, w.instance, w.serves_at};
}

Bytes Encode(const Welcome& m) {
  wire::WelcomeT w;
  w.scene_id.assign(m.scene_id.begin(), m.scene_id.end());
  w.worker = m.worker;
  w.sources = m.sources;
  return Pack<wire::Welcome>(w);
}

Result<Welcome> DecodeWelcome(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::Welcome>(table));
  Welcome m;
  if (w.scene_id.size() != m.scene_id.size()) return Fail("received a welcome that is not well formed");
  std::copy(w.scene_id.begin(), w.scene_id.end(), m.scene_id.begin());
  m.worker = w.worker;
  m.sources = w.sources;
  return m;
}

Bytes Encode(const Failure& m) {
  wire::FailureT w;
  w.message = m.message;
  return Pack<wire::Failure>(w);
}

Result<Failure> DecodeFailure(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::Failure>(table));
  if (w.message.empty()) return Fail("received a failure without a reason");
  return Failure{Legible(w.message)};
}

Bytes Encode(const JobRequest& m) {
  wire::JobRequestT w;
  w.job = std::make_unique<wire::JobT>(JobToWire(m.job));
  w.have = m.have;
  return Pack<wire::JobRequest>(w);
}

Result<JobRequest> DecodeJobRequest(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::JobRequest>(table));
  if (!w.job) return Fail("received a request without a job");
  JobRequest m;
  QUARRY_ASSIGN(m.job, JobFromWire(*w.job));
  m.have = w.have;
  if (m.have > m.job.cameras.size())
    return Fail("received a request that has more frames already than its job has");
  return m;
}

Bytes Encode(const FrameProgress& m) {
  wire::FrameProgressT w;
  w.frame = m.frame;
  w.tiles_done = m.tiles_done;
  w.tiles = m.tiles;
  w.workers = m.workers;
  return Pack<wire::FrameProgress>(w);
}

Result<FrameProgress> DecodeFrameProgress(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::FrameProgress>(table));
  return FrameProgress{w.frame, w.tiles_done, w.tiles, w.workers};
}

Bytes Encode(const FrameDone& m) {
  wire::FrameDoneT w;
  w.frame = m.frame;
  w.statistics = m.statistics;
  return Pack<wire::FrameDone>(w);
}

Result<FrameDone> DecodeFrameDone(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::FrameDone>(table));
  return FrameDone{w.frame, w.statistics};
}

Bytes Encode(const FrameSetup& m) {
  wire::FrameSetupT w;
  w.setup = m.setup;
  w.oldest = m.oldest;
  w.job = std::make_unique<wire::JobT>(JobToWire(m.job));
  return Pack<wire::FrameSetup>(w);
}

Result<FrameSetup> DecodeFrameSetup(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::FrameSetup>(table));
  if (!w.job) return Fail("received a frame without a job");
  FrameSetup m;
  m.setup = w.setup;
  m.oldest = w.oldest;
  QUARRY_ASSIGN(m.job, JobFromWire(*w.job));
  return m;
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

Result<TileOrder> DecodeTileOrder(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::TileOrder>(table));
  if (w.width == 0 || w.height == 0 || w.width > kTileSize || w.height > kTileSize || w.x >= kMaxImageSide ||
      w.y >= kMaxImageSide || w.blocks.size() > kMaxTileHints || w.holders.size() != w.blocks.size())
    return Fail("received a tile that cannot be");
  return TileOrder{w.setup, w.tile, w.lease, w.x, w.y, w.width, w.height, w.blocks, w.holders};
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

Result<TileDone> DecodeTileDone(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::TileDone>(table));
  constexpr size_t kCells = kTileSize / kDepthCell;
  if (w.blocks.size() > kMaxTileBlocks || w.depths.size() > kCells * kCells ||
      !std::ranges::all_of(w.depths, [](float depth) { return depth >= 0; }))
    return Fail("received a tile's result that cannot be");
  return TileDone{w.setup, w.tile, w.lease, w.rays, w.rays_suspended, w.compute_us, w.depths, w.blocks};
}

Bytes Encode(const Peers& m) {
  wire::PeersT w;
  w.workers = m.workers;
  w.endpoints = m.endpoints;
  return Pack<wire::Peers>(w);
}

Result<Peers> DecodePeers(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::Peers>(table));
  if (w.workers.size() != w.endpoints.size())
    return Fail("received a list of workers that is not well formed");
  return Peers{w.workers, w.endpoints};
}

Bytes Encode(const Alive& m) {
  wire::AliveT w;
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
  return Pack<wire::Alive>(w);
}

Result<Alive> DecodeAlive(std::span<const std::byte> table) {
  QUARRY_ASSIGN(auto w, Unpack<wire::Alive>(table));
  Alive m;
  if (w.bytes_from.size() != m.bytes_from.size()) return Fail("received counters that are not well formed");
  m.cache_bytes = w.cache_bytes;
  m.voxels_loaded = w.voxels_loaded;
  m.voxel_bytes_loaded = w.voxel_bytes_loaded;
  m.voxel_bytes_received = w.voxel_bytes_received;
  m.evictions = w.evictions;
  m.rays = w.rays;
  m.rays_suspended = w.rays_suspended;
  m.peak_rss_bytes = w.peak_rss_bytes;
  m.whole = w.whole;
  m.cached = std::move(w.cached);
  m.dropped = std::move(w.dropped);
  std::copy(w.bytes_from.begin(), w.bytes_from.end(), m.bytes_from.begin());
  m.retries = w.retries;
  m.hedges = w.hedges;
  m.damaged = w.damaged;
  m.stall_us = w.stall_us;
  m.compute_us = w.compute_us;
  m.fetch_us = w.fetch_us;
  m.prefetched_bytes = w.prefetched_bytes;
  m.prefetch_wasted_bytes = w.prefetch_wasted_bytes;
  m.decode_us = w.decode_us;
  m.tiles_wanted = w.tiles_wanted;
  return m;
}

Bytes Encode(const BlockRequest& m) {
  wire::BlockRequestT w;
  w.block = m.block;
  return Pack<wire::BlockRequest>(w);
}

Result<BlockRequest> DecodeBlockRequest(std::span<const std::byte> table) {
  QUARRY_ASSIGN(const auto w, Unpack<wire::BlockRequest>(table));
  return BlockRequest{w.block};
}

}  // namespace quarry
