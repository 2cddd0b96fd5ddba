#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/protocol/frame.h"
#include "common/scene/ray_query.h"
#include "common/scene/render_job.h"
#include "common/scene/tile.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// The purpose of a connection, stated by the side that connects.
enum class Role : uint8_t { kWorker = 0, kVoxels = 1, kClient = 2 };

/// The first message of a connection, from the side that connected.
struct Hello {
  Role role = Role::kWorker;
  std::string name;
  uint32_t threads = 0;
  uint64_t instance = 0;   ///< a worker's random number, which identifies it after a loss of the connection
  uint16_t serves_at = 0;  ///< port at which a worker serves blocks to others; 0: none
  /// How the worker ended that this one replaces ("killed by signal 9, out of memory?"); mostly empty.
  std::string previous_end = {};
  /// With kVoxels: the store whose blocks are wanted; zeros: the scene's.
  SceneId store{};
};
/// The answer to a Hello.
struct Welcome {
  SceneId scene_id{};
  uint32_t worker = 0;
  std::vector<std::string> sources;  ///< sources of blocks, as ParseSource() reads them
  uint64_t environment_bytes = 0;    ///< decoded, of the largest environment that views may name
};
/// The reason why the sender ends a connection or refuses a request: a sentence for the user.
struct Failure {
  std::string message;
};
/// Asks for the frames of a job.
struct JobRequest {
  RenderJob job;
  uint32_t have = 0;  ///< the client has the first `have` frames; they are not sent
};
/// A question of a client's. The answer, of type kAnswer, has JSON for its raw part.
struct Query {
  std::string topic;  ///< kSceneTopic or kStatusTopic
};
inline constexpr const char* kSceneTopic = "scene";    ///< DescribeFacts() with a framing: see SceneSummary
inline constexpr const char* kStatusTopic = "status";  ///< workers, jobs and rates
/// Progress of the frame that the client waits for.
struct FrameProgress {
  uint32_t frame = 0, tiles_done = 0, tiles = 0, workers = 0;
};
/// A finished frame; the raw part is the image file.
struct FrameDone {
  uint32_t frame = 0;
  std::string statistics;  ///< JSON
};
/// The parts that views show; views name it by its id. A worker keeps the newest kMostSelections, and
/// the selections of its views.
using SelectionSetup = PartSelection;
inline constexpr size_t kMostSelections = 4;
/// An environment; the raw part has its packed catalog. A worker keeps all that it has been sent.
struct EnvironmentSetup {
  SceneId id{};
};
/// A frame to render. The id of the view's selection travels; the receiver puts the selection there.
struct FrameSetup {
  uint64_t frame = 0;  ///< its number, which its tiles name
  View view;
  uint64_t oldest = 0;     ///< frames below this number have ended
  uint64_t selection = 0;  ///< decoded: the id of the view's selection; 0: all parts as they are
};
/// A tile to render under a lease. A result that its sender holds no lease of is dropped.
struct TileOrder {
  uint64_t frame = 0;
  uint32_t tile = 0;
  uint64_t lease = 0;
  Tile area;                      ///< colours, not hits
  std::vector<uint32_t> blocks;   ///< hint: blocks that the tile needs and the worker lacks
  std::vector<uint32_t> holders;  ///< hint: for each of `blocks` a worker that has it, or 0
  Urgency urgency = Urgency::kJob;
};
/// Frames that nobody waits for any more. Their tiles are dropped or abandoned.
struct FramesEnd {
  std::vector<uint64_t> frames;
};
inline constexpr size_t kMaxFramesEnded = 1024;     ///< limit of frames in a FramesEnd
inline constexpr size_t kMaxTileBlocks = 1u << 20;  ///< limit of blocks in a TileDone
inline constexpr size_t kMaxTileHints = 4096;       ///< limit of blocks in a TileOrder
/// A worker leaves: it takes no tile more.
struct Leave {
  std::vector<uint64_t> frames, leases;  ///< of tiles that it has not begun and gives back
  bool last = false;                     ///< nothing follows; the master closes the connection
};
inline constexpr size_t kMaxGivenBack = 4096;  ///< limit of tiles in a Leave
/// A rendered tile; the raw part is its pixels.
struct TileDone {
  uint64_t frame = 0;
  uint32_t tile = 0;
  uint64_t lease = 0;
  uint64_t rays = 0, rays_suspended = 0;
  uint64_t compute_us = 0;  ///< time spent on the tile, without waits for blocks
  /// Per depth cell, row by row: t where the farthest primary ray ends. Empty unless for a job.
  std::vector<float> depths;
  std::vector<uint32_t> blocks;  ///< blocks that its rays touched, ascending; empty unless for a job
  uint64_t saturated = 0, not_numbers = 0, long_light_rays = 0;  ///< see FilmFaults
};
/// A ray whose nearest hit is wanted, under a lease.
struct RayOrder {
  uint32_t ray = 0;
  uint64_t lease = 0;
  RayQuery query;
  ViewParts parts;         ///< that the ray may hit; its selection's id travels
  SectionCut section;      ///< of the view
  uint64_t selection = 0;  ///< decoded: the id of the selection; 0: all parts
};
/// The nearest hit of a ray.
struct RayDone {
  uint32_t ray = 0;
  uint64_t lease = 0;
  float t = 0;            ///< distance from the ray's origin, scene units
  uint32_t triangle = 0;  ///< scene-wide id; kNoIndex: the ray hits nothing
  uint32_t voxel = 0;     ///< the voxel in which the triangle was found
  uint32_t local = 0;     ///< the triangle's index in that voxel
};
/// The workers that serve blocks to others.
struct Peers {
  std::vector<uint32_t> workers;
  std::vector<std::string> endpoints;  ///< HOST:PORT of each
};
/// Kinds of sources of blocks, for counters.
enum class SourceKind : uint8_t { kFile, kTcp, kHttp, kPeer, kDisk, kMemory };
inline constexpr size_t kSourceKinds = 6;
/// A worker's counters since its start, and the changes of its cache since the last WorkerStatus. Names of
/// counters end in their units.
struct WorkerStatus {
  uint64_t cache_bytes = 0, voxels_loaded = 0, voxel_bytes_loaded = 0, voxel_bytes_received = 0,
           evictions = 0;
  uint64_t rays = 0, rays_suspended = 0, peak_rss_bytes = 0;
  bool whole = false;  ///< `cached` lists all blocks of the cache, not only new ones
  std::vector<uint32_t> cached, dropped;
  std::array<uint64_t, kSourceKinds> bytes_from{};
  uint64_t retries = 0, hedges = 0, damaged = 0;
  uint64_t stall_us = 0, compute_us = 0;  ///< summed over the compute threads
  uint64_t fetch_us = 0;                  ///< time with a block on its way from a source
  uint64_t prefetched_bytes = 0, prefetch_wasted_bytes = 0;
  uint64_t decode_us = 0;     ///< time spent decoding blocks, getting memory included
  uint32_t tiles_wanted = 0;  ///< tiles to have at once; 0: FewestTiles()
};
/// Asks for a stored block.
struct BlockRequest {
  uint32_t block = 0;
};
/// Limit of unanswered BlockRequests of a connection; a peer that exceeds it is dropped. Bounds a server's
/// memory for requests. A judgement: a worker has at most Loader::kMaxInFlight requests and some prefetches
/// under way.
inline constexpr uint32_t kMostBlockRequests = 1024;

/// Encodes a message's table, for Message::table.
Bytes Encode(const Hello& m);
Bytes Encode(const Welcome& m);
Bytes Encode(const Failure& m);
Bytes Encode(const JobRequest& m);
Bytes Encode(const Query& m);
Bytes Encode(const FrameProgress& m);
Bytes Encode(const FrameDone& m);
Bytes Encode(const SelectionSetup& m);
Bytes Encode(const EnvironmentSetup& m);
Bytes Encode(const FrameSetup& m);
Bytes Encode(const TileOrder& m);
Bytes Encode(const FramesEnd& m);
Bytes Encode(const Leave& m);
Bytes Encode(const TileDone& m);
Bytes Encode(const RayOrder& m);
Bytes Encode(const RayDone& m);
Bytes Encode(const Peers& m);
Bytes Encode(const WorkerStatus& m);
Bytes Encode(const BlockRequest& m);

/// Decodes a message's table. FlatBuffers verifies it, then every value is checked. Thread-safe.
/// Errors: not well formed; a value out of range.
Result<Hello> DecodeHello(std::span<const std::byte> table);
Result<Welcome> DecodeWelcome(std::span<const std::byte> table);
Result<Failure> DecodeFailure(std::span<const std::byte> table);
Result<JobRequest> DecodeJobRequest(std::span<const std::byte> table);
Result<Query> DecodeQuery(std::span<const std::byte> table);
Result<FrameProgress> DecodeFrameProgress(std::span<const std::byte> table);
Result<FrameDone> DecodeFrameDone(std::span<const std::byte> table);
Result<SelectionSetup> DecodeSelection(std::span<const std::byte> table);
Result<EnvironmentSetup> DecodeEnvironment(std::span<const std::byte> table);
Result<FrameSetup> DecodeFrameSetup(std::span<const std::byte> table);
Result<TileOrder> DecodeTileOrder(std::span<const std::byte> table);
Result<FramesEnd> DecodeFramesEnd(std::span<const std::byte> table);
Result<Leave> DecodeLeave(std::span<const std::byte> table);
Result<TileDone> DecodeTileDone(std::span<const std::byte> table);
Result<RayOrder> DecodeRayOrder(std::span<const std::byte> table);
Result<RayDone> DecodeRayDone(std::span<const std::byte> table);
Result<Peers> DecodePeers(std::span<const std::byte> table);
Result<WorkerStatus> DecodeWorkerStatus(std::span<const std::byte> table);
Result<BlockRequest> DecodeBlockRequest(std::span<const std::byte> table);

/// A message with an encoded table and no raw part.
template <class T>
Message MakeMessage(MessageType type, const T& content, uint64_t request = 0) {
  return {type, request, Encode(content), {}};
}

}  // namespace quarry
