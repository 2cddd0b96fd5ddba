#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/protocol/frame.h"
#include "common/scene/render_job.h"
#include "common/voxel/catalog.h"

namespace quarry {

enum class Role : uint8_t { kWorker = 0, kVoxels = 1, kClient = 2 };

/// The first message of a connection, from the side that connected.
struct Hello {
  Role role = Role::kWorker;
  std::string name;
  uint32_t threads = 0;
  uint64_t instance = 0;   ///< a worker's own number, by which a master knows it again after a loss
  uint16_t serves_at = 0;  ///< port at which a worker serves blocks to others; 0: it does not
};
struct Welcome {
  SceneId scene_id{};
  uint32_t worker = 0;
  std::vector<std::string> sources;  ///< where blocks come from, see SourceList
};
/// A sentence for the person, before the connection ends.
struct Failure {
  std::string message;
};
struct JobRequest {
  RenderJob job;
  uint32_t have = 0;  ///< so many frames, from the first, are not sent again
};
struct FrameProgress {
  uint32_t frame = 0, tiles_done = 0, tiles = 0, workers = 0;
};
struct FrameDone {
  uint32_t frame = 0;
  std::string statistics;  ///< JSON
};
struct FrameSetup {
  uint64_t frame = 0;  ///< its id, which tiles name
  View view;
  uint64_t oldest = 0;  ///< frames below this are over
};
/// A tile handed out under a lease: results under another lease or of another frame are dropped.
struct TileOrder {
  uint64_t frame = 0;
  uint32_t tile = 0;
  uint64_t lease = 0;
  uint32_t x = 0, y = 0, width = 0, height = 0;
  std::vector<uint32_t> blocks;   ///< expected to be needed and not to be there; a hint
  std::vector<uint32_t> holders;  ///< for each of them a worker that has it, or 0; a hint
};
inline constexpr size_t kMaxTileBlocks = 1u << 20;  ///< blocks that a message about a tile may name
inline constexpr size_t kMaxTileHints = 4096;       ///< blocks that a tile order may name
struct TileDone {
  uint64_t frame = 0;
  uint32_t tile = 0;
  uint64_t lease = 0;
  uint64_t rays = 0, rays_suspended = 0;
  uint64_t compute_us = 0;       ///< time spent on it, waiting for blocks not counted
  std::vector<float> depths;     ///< of its depth cells, row by row: where the farthest primary ray ends
  std::vector<uint32_t> blocks;  ///< that its rays have been in, ascending
};
/// Which workers serve blocks to others.
struct Peers {
  std::vector<uint32_t> workers;
  std::vector<std::string> endpoints;  ///< HOST:PORT of each
};
/// Where bytes have come from, as counted.
enum class SourceKind : uint8_t { kFile, kTcp, kHttp, kPeer, kDisk, kMemory };
inline constexpr size_t kSourceKinds = 6;
/// A worker's counters since it started, and what has changed in its cache since the last.
struct WorkerStatus {
  uint64_t cache_bytes = 0, voxels_loaded = 0, voxel_bytes_loaded = 0, voxel_bytes_received = 0,
           evictions = 0;
  uint64_t rays = 0, rays_suspended = 0, peak_rss_bytes = 0;
  bool whole = false;  ///< `cached` is all there is
  std::vector<uint32_t> cached, dropped;
  std::array<uint64_t, kSourceKinds> bytes_from{};
  uint64_t retries = 0, hedges = 0, damaged = 0;
  uint64_t stall_us = 0, compute_us = 0;  ///< summed over the compute threads
  uint64_t fetch_us = 0;                  ///< in which blocks were on their way from a source
  uint64_t prefetched_bytes = 0, prefetch_wasted_bytes = 0;
  uint64_t decode_us = 0;     ///< in which blocks were decoded, memory for them included
  uint32_t tiles_wanted = 0;  ///< to have at once; 0: FewestTiles
};
struct BlockRequest {
  uint32_t block = 0;
};
/// Of a connection, while their answers have not gone out; who asks for more is dropped.
inline constexpr uint32_t kMostBlockRequests = 1024;

/// One function a message: the table's bytes, to be put into Message::table.
Bytes Encode(const Hello& m);
Bytes Encode(const Welcome& m);
Bytes Encode(const Failure& m);
Bytes Encode(const JobRequest& m);
Bytes Encode(const FrameProgress& m);
Bytes Encode(const FrameDone& m);
Bytes Encode(const FrameSetup& m);
Bytes Encode(const TileOrder& m);
Bytes Encode(const TileDone& m);
Bytes Encode(const Peers& m);
Bytes Encode(const WorkerStatus& m);
Bytes Encode(const BlockRequest& m);

/// And back: verified by FlatBuffers, then every value checked. Errors: one sentence; nothing is believed
/// before.
Result<Hello> DecodeHello(std::span<const std::byte> table);
Result<Welcome> DecodeWelcome(std::span<const std::byte> table);
Result<Failure> DecodeFailure(std::span<const std::byte> table);
Result<JobRequest> DecodeJobRequest(std::span<const std::byte> table);
Result<FrameProgress> DecodeFrameProgress(std::span<const std::byte> table);
Result<FrameDone> DecodeFrameDone(std::span<const std::byte> table);
Result<FrameSetup> DecodeFrameSetup(std::span<const std::byte> table);
Result<TileOrder> DecodeTileOrder(std::span<const std::byte> table);
Result<TileDone> DecodeTileDone(std::span<const std::byte> table);
Result<Peers> DecodePeers(std::span<const std::byte> table);
Result<WorkerStatus> DecodeWorkerStatus(std::span<const std::byte> table);
Result<BlockRequest> DecodeBlockRequest(std::span<const std::byte> table);

/// A whole message around an encoded table.
template <class T>
Message MakeMessage(MessageType type, const T& content, uint64_t request = 0) {
  return {type, request, Encode(content), {}};
}

}  // namespace quarry
