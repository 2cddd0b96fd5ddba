#include "common/protocol/messages.h"

#include <flatbuffers/util.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "common/protocol/selection_messages.h"
#include "common/protocol/wire_reading.h"
#include "common/scene/sky/atmosphere.h"

// Fields are read in place from the verified buffer. FlatBuffers allows many references to one table, vector
// or string, so a small message could unpack to gigabytes. Therefore every count and length is checked before
// anything is copied, and the message must have as many bytes as its lists take without sharing.

namespace quarry {
namespace {

/// Least bytes of a camera and a light in a message from Encode(), which shares none.
constexpr size_t kLeastCameraBytes = 96, kLeastLightBytes = 56;
/// Limit of a text. A failure or a frame's statistics are shorter.
constexpr size_t kMostTextBytes = 1u << 20;

bool ReadLight(const wire::Light& l, Light& light) {
  light.kind = static_cast<LightKind>(l.kind());
  light.cone_scale = l.cone_scale();
  light.cone_offset = l.cone_offset();
  light.angle = l.angle();
  light.at_eye = l.at_eye();
  light.radius = l.radius();
  if (light.kind == LightKind::kRectangle) {
    if (SizeOf(l.edges()) != 6) return false;
    for (uint32_t i = 0; i < 6; ++i) light.edges[i / 3][static_cast<int>(i % 3)] = l.edges()->Get(i);
  }
  return l.kind() < kLightKinds && Read(l.vector(), light.vector) && Read(l.radiance(), light.radiance) &&
         Read(l.axis(), light.axis);
}

bool ReadCamera(const wire::Camera& c, CameraSpec& camera) {
  camera.fov_degrees = c.fov_degrees();
  camera.ortho_height = c.ortho_height();
  camera.aperture = c.aperture();
  camera.focus = c.focus();
  return Read(c.eye(), camera.eye) && Read(c.at(), camera.at) && Read(c.up(), camera.up);
}

/// The text as UTF-8 without control characters: it is printed on terminals and written as JSON.
std::string Legible(const flatbuffers::String* text);

/// Copies an id. Returns: false where it has another size.
bool ReadId(const flatbuffers::Vector<uint8_t>* bytes, SceneId& id) {
  if (SizeOf(bytes) != id.size()) return false;
  std::copy(bytes->begin(), bytes->end(), id.begin());
  return true;
}

Status ReadEnvironment(const wire::Environment* w, ViewEnvironment& environment) {
  constexpr size_t kMostNameBytes = 4096;
  if (!w) return {};
  if (SizeOf(w->name()) > kMostNameBytes || (SizeOf(w->id()) != 0 && !ReadId(w->id(), environment.id)))
    return Fail("received an environment that is not well formed");
  environment.name = Legible(w->name());
  environment.turn = w->turn();
  environment.strength = w->strength();
  return {};
}

/// A client sends the haze alone, a master the table too.
Status ReadAtmosphere(const wire::Atmosphere* w, Sky& sky) {
  if (!w) return {};
  sky.haze = w->haze();
  if (!(sky.haze >= kLeastHaze && sky.haze <= kMostHaze))
    return Fail("received an atmosphere without a haze");
  if (!w->radiance()) return {};
  constexpr uint32_t kNumbers = 3 * AtmosphereTable::kRows * AtmosphereTable::kColumns;
  AtmosphereTable table;
  if (w->radiance()->size() != kNumbers || !Read(w->sun(), table.sun))
    return Fail("received an atmosphere that is not well formed");
  constexpr float kMost = 1e6f;
  const auto is_light = [](float x) { return x >= 0 && x <= kMost; };
  bool are_light = is_light(table.sun.x) && is_light(table.sun.y) && is_light(table.sun.z);
  for (uint32_t i = 0; i < kNumbers; i += 3) {
    const auto& numbers = *w->radiance();
    table.radiance.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
    are_light &= is_light(numbers[i]) && is_light(numbers[i + 1]) && is_light(numbers[i + 2]);
  }
  if (!are_light) return Fail("received an atmosphere with a radiance that is no number");
  sky.atmosphere = std::make_shared<const AtmosphereTable>(std::move(table));
  return {};
}

/// Copies a view but for its camera. Errors: too many lights, or entries that share bytes.
Status ReadView(const wire::View& w, size_t message_bytes, View& view) {
  const size_t lights = SizeOf(w.lights());
  if (SizeOf(w.crop()) != 4 || !Read(w.ambient(), view.ambient) || !Read(w.background(), view.background) ||
      (w.sky() && !Read(w.sky(), view.sky.radiance)) || lights > kMaxLights ||
      lights * kLeastLightBytes > message_bytes)
    return Fail("received a view that is not well formed");
  view.lights.resize(lights);
  for (uint32_t i = 0; i < lights; ++i)
    if (!ReadLight(*w.lights()->Get(i), view.lights[i]))
      return Fail("received a light that is not well formed");
  view.crop = {w.crop()->Get(0), w.crop()->Get(1), w.crop()->Get(2), w.crop()->Get(3)};
  view.width = w.width();
  view.height = w.height();
  view.mode = static_cast<RenderMode>(w.mode());
  view.spp = w.spp();
  view.seed = w.seed();
  view.aov_mask = w.aov_mask();
  view.up_axis = w.up_axis();
  view.ao_samples = w.ao_samples();
  view.ao_distance = w.ao_distance();
  view.backdrop = !w.background_is_light();
  view.edges = w.edges();
  view.bounces = w.bounces();
  view.sky.turbidity = w.turbidity();
  view.range = w.range();
  view.meters = w.meters();
  view.noise = w.noise();
  view.transparent = w.transparent();
  QUARRY_TRY(ReadEnvironment(w.environment(), view.environment));
  QUARRY_TRY(ReadAtmosphere(w.atmosphere(), view.sky));
  return ReadSection(w.section(), view.section);
}

Result<RenderJob> ReadJob(const wire::Job& w, size_t message_bytes) {
  RenderJob job;
  constexpr size_t kMostFormatBytes = 8;
  const size_t cameras = SizeOf(w.cameras());
  if (!w.view() || SizeOf(w.format()) > kMostFormatBytes || cameras > kMaxFrames ||
      SizeOf(w.view()->lights()) * kLeastLightBytes + cameras * kLeastCameraBytes > message_bytes)
    return Fail("received a render job that is not well formed");
  QUARRY_TRY(ReadView(*w.view(), message_bytes, job.view));
  job.cameras.resize(cameras);
  for (uint32_t i = 0; i < cameras; ++i)
    if (!ReadCamera(*w.cameras()->Get(i), job.cameras[i]))
      return Fail("received a render job that is not well formed");
  job.first_frame = w.first_frame();
  job.format.name = w.format() ? w.format()->str() : std::string();
  if (!w.automatic_exposure()) job.format.exposure = w.exposure();
  constexpr uint8_t kByMode = 255;
  if (w.tone() != kByMode && w.tone() >= kToneCurves)
    return Fail("received a render job that is not well formed");
  if (w.tone() != kByMode) job.format.tone = static_cast<ToneCurve>(w.tone());
  if (w.parts()) {
    QUARRY_ASSIGN(job.view.parts.lists, ReadPartLists(*w.parts(), message_bytes));
  }
  QUARRY_TRY(NormalizeJob(job));
  return job;
}

std::string Legible(const flatbuffers::String* text) {
  std::string legible;
  if (!text) return legible;
  const char* at = text->c_str();
  while (at < text->c_str() + text->size()) {
    const char* next = at;
    const int code = flatbuffers::FromUTF8(&next);  // -1 for an invalid or cut sequence
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

Result<Hello> DecodeHello(std::span<const std::byte> table) {
  const auto* w = Root<wire::Hello>(table);
  if (!w) return NotWellFormed();
  const bool idle = static_cast<Role>(w->role()) == Role::kWorker && w->threads() == 0;
  if (w->role() > 2 || SizeOf(w->name()) > 256 || SizeOf(w->previous_end()) > 256 || w->threads() > 4096 ||
      idle)
    return Fail("received a greeting that is not well formed");
  Hello m{static_cast<Role>(w->role()), Legible(w->name()), w->threads(), w->instance(), w->serves_at(),
          Legible(w->previous_end())};
  if (SizeOf(w->store()) != 0 && !ReadId(w->store(), m.store))
    return Fail("received a greeting that is not well formed");
  return m;
}

Result<Welcome> DecodeWelcome(std::span<const std::byte> table) {
  const auto* w = Root<wire::Welcome>(table);
  if (!w) return NotWellFormed();
  Welcome m;
  if (SizeOf(w->scene_id()) != m.scene_id.size() || !Read(w->sources(), table.size(), m.sources))
    return Fail("received a welcome that is not well formed");
  std::copy(w->scene_id()->begin(), w->scene_id()->end(), m.scene_id.begin());
  m.worker = w->worker();
  m.environment_bytes = w->environment_bytes();
  return m;
}

Result<Failure> DecodeFailure(std::span<const std::byte> table) {
  const auto* w = Root<wire::Failure>(table);
  if (!w) return NotWellFormed();
  if (SizeOf(w->message()) == 0) return Fail("received a failure without a reason");
  if (w->message()->size() > kMostTextBytes) return NotWellFormed();
  return Failure{Legible(w->message())};
}

Result<JobRequest> DecodeJobRequest(std::span<const std::byte> table) {
  const auto* w = Root<wire::JobRequest>(table);
  if (!w) return NotWellFormed();
  if (!w->job()) return Fail("received a request without a job");
  JobRequest m;
  QUARRY_ASSIGN(m.job, ReadJob(*w->job(), table.size()));
  m.job.view.sky.atmosphere = nullptr;  // the master makes it
  m.have = w->have();
  if (m.have > m.job.cameras.size())
    return Fail("received a request that claims more frames than its job has");
  return m;
}

Result<Query> DecodeQuery(std::span<const std::byte> table) {
  const auto* w = Root<wire::Query>(table);
  if (!w) return NotWellFormed();
  Query m{Legible(w->topic())};
  if (m.topic != kSceneTopic && m.topic != kStatusTopic) return Fail("received an unknown question");
  return m;
}

Result<FrameProgress> DecodeFrameProgress(std::span<const std::byte> table) {
  const auto* w = Root<wire::FrameProgress>(table);
  if (!w) return NotWellFormed();
  return FrameProgress{w->frame(), w->tiles_done(), w->tiles(), w->workers()};
}

Result<FrameDone> DecodeFrameDone(std::span<const std::byte> table) {
  const auto* w = Root<wire::FrameDone>(table);
  if (!w || SizeOf(w->statistics()) > kMostTextBytes) return NotWellFormed();
  return FrameDone{w->frame(), w->statistics() ? w->statistics()->str() : std::string()};
}

Result<EnvironmentSetup> DecodeEnvironment(std::span<const std::byte> table) {
  const auto* w = Root<wire::EnvironmentSetup>(table);
  EnvironmentSetup m;
  if (!w || !ReadId(w->id(), m.id)) return NotWellFormed();
  return m;
}

Result<FrameSetup> DecodeFrameSetup(std::span<const std::byte> table) {
  const auto* w = Root<wire::FrameSetup>(table);
  if (!w) return NotWellFormed();
  FrameSetup m;
  m.frame = w->frame();
  m.oldest = w->oldest();
  m.selection = w->view() ? w->view()->selection() : 0;
  if (!w->view() || !w->view()->camera() || !ReadCamera(*w->view()->camera(), m.view.camera))
    return Fail("received a frame without a view");
  QUARRY_TRY(ReadView(*w->view(), table.size(), m.view));
  QUARRY_TRY(NormalizeView(m.view));
  if (InfoOf(m.view.mode).bounces && m.view.sky.haze > 0 && !m.view.sky.atmosphere)
    return Fail("received an atmosphere without its light");
  return m;
}

Result<TileOrder> DecodeTileOrder(std::span<const std::byte> table) {
  const auto* w = Root<wire::TileOrder>(table);
  if (!w) return NotWellFormed();
  const size_t blocks = SizeOf(w->blocks());
  if (w->form() > static_cast<uint8_t>(PixelForm::kShown) || w->urgency() >= kUrgencies ||
      blocks > kMaxTileHints || SizeOf(w->holders()) != blocks)
    return Fail("received an invalid tile");
  TileOrder m{w->frame(), w->tile(), w->lease()};
  m.area.pixels = {w->x(), w->y(), w->width(), w->height()};
  m.area.step = w->step();
  m.area.phase_x = w->phase_x();
  m.area.phase_y = w->phase_y();
  m.area.first_sample = w->first_sample();
  m.area.samples = w->samples();
  m.area.form = static_cast<PixelForm>(w->form());
  m.area.leaves_holes = w->leaves_holes();
  m.urgency = static_cast<Urgency>(w->urgency());
  m.blocks = Copy(w->blocks());
  m.holders = Copy(w->holders());
  return m;
}

Result<FramesEnd> DecodeFramesEnd(std::span<const std::byte> table) {
  const auto* w = Root<wire::FramesEnd>(table);
  if (!w || SizeOf(w->frames()) > kMaxFramesEnded) return NotWellFormed();
  return FramesEnd{Copy(w->frames())};
}

Result<Leave> DecodeLeave(std::span<const std::byte> table) {
  const auto* w = Root<wire::Leave>(table);
  if (!w || SizeOf(w->frames()) > kMaxGivenBack || SizeOf(w->frames()) != SizeOf(w->leases()))
    return NotWellFormed();
  return Leave{Copy(w->frames()), Copy(w->leases()), w->last()};
}

Result<TileDone> DecodeTileDone(std::span<const std::byte> table) {
  const auto* w = Root<wire::TileDone>(table);
  if (!w) return NotWellFormed();
  constexpr size_t kCells = kTileSize / kDepthCell;  // other tiles than jobs' and meters' have none
  if (SizeOf(w->blocks()) > kMaxTileBlocks || SizeOf(w->depths()) > kCells * kCells)
    return Fail("received an invalid result of a tile");
  std::vector<float> depths = Copy(w->depths());
  if (!std::ranges::all_of(depths, [](float depth) { return depth >= 0; }))
    return Fail("received an invalid result of a tile");
  return TileDone{w->frame(),          w->tile(),        w->lease(),          w->rays(),
                  w->rays_suspended(), w->compute_us(),  std::move(depths),   Copy(w->blocks()),
                  w->saturated(),      w->not_numbers(), w->long_light_rays()};
}

Result<RayOrder> DecodeRayOrder(std::span<const std::byte> table) {
  const auto* w = Root<wire::RayOrder>(table);
  RayOrder m;
  if (!w || !Read(w->origin(), m.query.origin) || !Read(w->direction(), m.query.direction))
    return NotWellFormed();
  m.ray = w->ray();
  m.lease = w->lease();
  m.query.end = w->end();
  m.selection = w->selection();
  QUARRY_TRY(ReadSection(w->section(), m.section));
  QUARRY_TRY(CheckRay(m.query));
  return m;
}

Result<RayDone> DecodeRayDone(std::span<const std::byte> table) {
  const auto* w = Root<wire::RayDone>(table);
  if (!w || !(w->t() >= 0)) return NotWellFormed();
  return RayDone{w->ray(), w->lease(), w->t(), w->triangle(), w->voxel(), w->local()};
}

Result<Peers> DecodePeers(std::span<const std::byte> table) {
  const auto* w = Root<wire::Peers>(table);
  Peers m;
  if (!w || SizeOf(w->workers()) != SizeOf(w->endpoints()) ||
      !Read(w->endpoints(), table.size(), m.endpoints))
    return Fail("received a list of workers that is not well formed");
  m.workers = Copy(w->workers());
  return m;
}

Result<WorkerStatus> DecodeWorkerStatus(std::span<const std::byte> table) {
  const auto* w = Root<wire::WorkerStatus>(table);
  if (!w) return NotWellFormed();
  WorkerStatus m;
  const size_t named = SizeOf(w->cached()) + SizeOf(w->dropped());
  if (SizeOf(w->bytes_from()) != m.bytes_from.size() || named * sizeof(uint32_t) > table.size())
    return Fail("received counters that are not well formed");
  m.cache_bytes = w->cache_bytes();
  m.voxels_loaded = w->voxels_loaded();
  m.voxel_bytes_loaded = w->voxel_bytes_loaded();
  m.voxel_bytes_received = w->voxel_bytes_received();
  m.evictions = w->evictions();
  m.rays = w->rays();
  m.rays_suspended = w->rays_suspended();
  m.peak_rss_bytes = w->peak_rss_bytes();
  m.whole = w->whole();
  m.cached = Copy(w->cached());
  m.dropped = Copy(w->dropped());
  std::copy(w->bytes_from()->begin(), w->bytes_from()->end(), m.bytes_from.begin());
  m.retries = w->retries();
  m.hedges = w->hedges();
  m.damaged = w->damaged();
  m.stall_us = w->stall_us();
  m.compute_us = w->compute_us();
  m.fetch_us = w->fetch_us();
  m.prefetched_bytes = w->prefetched_bytes();
  m.prefetch_wasted_bytes = w->prefetch_wasted_bytes();
  m.decode_us = w->decode_us();
  m.tiles_wanted = w->tiles_wanted();
  return m;
}

Result<BlockRequest> DecodeBlockRequest(std::span<const std::byte> table) {
  const auto* w = Root<wire::BlockRequest>(table);
  if (!w) return NotWellFormed();
  return BlockRequest{w->block()};
}

}  // namespace quarry
