#include <memory>

#include "common/protocol/messages.h"
#include "common/protocol/selection_messages.h"
#include "common/protocol/wire_reading.h"
#include "common/scene/sky/atmosphere.h"

namespace quarry {
namespace {

template <class V>
auto ToVector(const V& v) {
  return std::vector<typename V::value_type>{v.x, v.y, v.z};
}

std::unique_ptr<wire::LightT> LightToWire(const Light& light) {
  auto w = std::make_unique<wire::LightT>();
  w->kind = static_cast<uint8_t>(light.kind);
  w->vector = ToVector(light.vector);
  w->radiance = ToVector(light.radiance);
  w->axis = ToVector(light.axis);
  w->cone_scale = light.cone_scale;
  w->cone_offset = light.cone_offset;
  w->angle = light.angle;
  w->at_eye = light.at_eye;
  w->radius = light.radius;
  if (light.kind == LightKind::kRectangle)
    for (const glm::vec3& edge : light.edges) w->edges.insert(w->edges.end(), {edge.x, edge.y, edge.z});
  return w;
}

std::unique_ptr<wire::CameraT> CameraToWire(const CameraSpec& camera) {
  auto w = std::make_unique<wire::CameraT>();
  w->eye = ToVector(camera.eye);
  w->at = ToVector(camera.at);
  w->up = ToVector(camera.up);
  w->fov_degrees = camera.fov_degrees;
  w->ortho_height = camera.ortho_height;
  w->aperture = camera.aperture;
  w->focus = camera.focus;
  return w;
}

std::unique_ptr<wire::AtmosphereT> AtmosphereToWire(const Sky& sky) {
  auto w = std::make_unique<wire::AtmosphereT>();
  w->haze = sky.haze;
  if (!sky.atmosphere) return w;
  for (const glm::vec3& radiance : sky.atmosphere->radiance)
    w->radiance.insert(w->radiance.end(), {radiance.x, radiance.y, radiance.z});
  w->sun = ToVector(sky.atmosphere->sun);
  return w;
}

/// Without the camera.
std::unique_ptr<wire::ViewT> ViewToWire(const View& view) {
  auto w = std::make_unique<wire::ViewT>();
  w->width = view.width;
  w->height = view.height;
  w->crop = {view.crop.x, view.crop.y, view.crop.width, view.crop.height};
  w->mode = static_cast<uint8_t>(view.mode);
  w->spp = view.spp;
  w->seed = view.seed;
  w->aov_mask = view.aov_mask;
  w->up_axis = static_cast<uint8_t>(view.up_axis);
  w->ao_samples = view.ao_samples;
  w->ao_distance = view.ao_distance;
  w->ambient = ToVector(view.ambient);
  w->background = ToVector(view.background);
  w->background_is_light = !view.backdrop;
  for (const Light& light : view.lights) w->lights.push_back(LightToWire(light));
  w->section = SectionToWire(view.section);
  w->edges = view.edges;
  w->bounces = view.bounces;
  w->sky = ToVector(view.sky.radiance);
  w->turbidity = view.sky.turbidity;
  if (view.sky.haze > 0) w->atmosphere = AtmosphereToWire(view.sky);
  w->meters = view.meters;
  w->noise = view.noise;
  w->transparent = view.transparent;
  w->range = static_cast<int8_t>(view.range);
  if (!view.environment.is_named()) return w;
  w->environment = std::make_unique<wire::EnvironmentT>();
  w->environment->name = view.environment.name;
  if (view.environment.shines())
    w->environment->id.assign(view.environment.id.begin(), view.environment.id.end());
  w->environment->turn = view.environment.turn;
  w->environment->strength = view.environment.strength;
  return w;
}

std::unique_ptr<wire::JobT> JobToWire(const RenderJob& job) {
  auto w = std::make_unique<wire::JobT>();
  w->view = ViewToWire(job.view);
  for (const CameraSpec& camera : job.cameras) w->cameras.push_back(CameraToWire(camera));
  w->first_frame = job.first_frame;
  w->format = job.format.name;
  w->exposure = job.format.exposure.value_or(0);
  w->automatic_exposure = !job.format.exposure;
  if (job.format.tone) w->tone = static_cast<uint8_t>(*job.format.tone);
  w->parts = PartListsToWire(job.view.parts.lists.get());
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
  w.previous_end = m.previous_end;
  if (m.store != SceneId{}) w.store.assign(m.store.begin(), m.store.end());
  return PackTable<wire::Hello>(w);
}

Bytes Encode(const Welcome& m) {
  wire::WelcomeT w;
  w.scene_id.assign(m.scene_id.begin(), m.scene_id.end());
  w.worker = m.worker;
  w.sources = m.sources;
  w.environment_bytes = m.environment_bytes;
  return PackTable<wire::Welcome>(w);
}

Bytes Encode(const Failure& m) {
  wire::FailureT w;
  w.message = m.message;
  return PackTable<wire::Failure>(w);
}

Bytes Encode(const JobRequest& m) {
  wire::JobRequestT w;
  w.job = JobToWire(m.job);
  w.have = m.have;
  return PackTable<wire::JobRequest>(w);
}

Bytes Encode(const Query& m) {
  wire::QueryT w;
  w.topic = m.topic;
  return PackTable<wire::Query>(w);
}

Bytes Encode(const FrameProgress& m) {
  wire::FrameProgressT w;
  w.frame = m.frame;
  w.tiles_done = m.tiles_done;
  w.tiles = m.tiles;
  w.workers = m.workers;
  return PackTable<wire::FrameProgress>(w);
}

Bytes Encode(const FrameDone& m) {
  wire::FrameDoneT w;
  w.frame = m.frame;
  w.statistics = m.statistics;
  return PackTable<wire::FrameDone>(w);
}

Bytes Encode(const EnvironmentSetup& m) {
  wire::EnvironmentSetupT w;
  w.id.assign(m.id.begin(), m.id.end());
  return PackTable<wire::EnvironmentSetup>(w);
}

Bytes Encode(const FrameSetup& m) {
  wire::FrameSetupT w;
  w.frame = m.frame;
  w.oldest = m.oldest;
  w.view = ViewToWire(m.view);
  w.view->camera = CameraToWire(m.view.camera);
  w.view->selection = m.view.parts.id();
  return PackTable<wire::FrameSetup>(w);
}

Bytes Encode(const TileOrder& m) {
  wire::TileOrderT w;
  w.frame = m.frame;
  w.tile = m.tile;
  w.lease = m.lease;
  w.x = m.area.pixels.x;
  w.y = m.area.pixels.y;
  w.width = m.area.pixels.width;
  w.height = m.area.pixels.height;
  w.step = m.area.step;
  w.phase_x = m.area.phase_x;
  w.phase_y = m.area.phase_y;
  w.first_sample = m.area.first_sample;
  w.samples = m.area.samples;
  w.form = static_cast<uint8_t>(m.area.form);
  w.leaves_holes = m.area.leaves_holes;
  w.urgency = static_cast<uint8_t>(m.urgency);
  w.blocks = m.blocks;
  w.holders = m.holders;
  return PackTable<wire::TileOrder>(w);
}

Bytes Encode(const FramesEnd& m) {
  wire::FramesEndT w;
  w.frames = m.frames;
  return PackTable<wire::FramesEnd>(w);
}

Bytes Encode(const Leave& m) {
  wire::LeaveT w;
  w.frames = m.frames;
  w.leases = m.leases;
  w.last = m.last;
  return PackTable<wire::Leave>(w);
}

Bytes Encode(const TileDone& m) {
  wire::TileDoneT w;
  w.frame = m.frame;
  w.tile = m.tile;
  w.lease = m.lease;
  w.rays = m.rays;
  w.rays_suspended = m.rays_suspended;
  w.compute_us = m.compute_us;
  w.saturated = m.saturated;
  w.not_numbers = m.not_numbers;
  w.long_light_rays = m.long_light_rays;
  w.depths = m.depths;
  w.blocks = m.blocks;
  return PackTable<wire::TileDone>(w);
}

Bytes Encode(const RayOrder& m) {
  wire::RayOrderT w;
  w.ray = m.ray;
  w.lease = m.lease;
  w.origin = ToVector(m.query.origin);
  w.direction = ToVector(m.query.direction);
  w.end = m.query.end;
  w.selection = m.parts.id();
  w.section = SectionToWire(m.section);
  return PackTable<wire::RayOrder>(w);
}

Bytes Encode(const RayDone& m) {
  wire::RayDoneT w;
  w.ray = m.ray;
  w.lease = m.lease;
  w.t = m.t;
  w.triangle = m.triangle;
  w.voxel = m.voxel;
  w.local = m.local;
  return PackTable<wire::RayDone>(w);
}

Bytes Encode(const Peers& m) {
  wire::PeersT w;
  w.workers = m.workers;
  w.endpoints = m.endpoints;
  return PackTable<wire::Peers>(w);
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
  return PackTable<wire::WorkerStatus>(w);
}

Bytes Encode(const BlockRequest& m) {
  wire::BlockRequestT w;
  w.block = m.block;
  return PackTable<wire::BlockRequest>(w);
}

}  // namespace quarry
