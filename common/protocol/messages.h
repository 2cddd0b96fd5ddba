#pragma once

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
};
struct Welcome {
  SceneId scene_id{};
  uint32_t worker = 0;
};
/// A sentence for the person, before the connection ends.
struct Failure {
  std::string message;
};
struct FrameProgress {
  uint32_t frame = 0, tiles_done = 0, tiles = 0, workers = 0;
};
struct FrameDone {
  uint32_t frame = 0;
  std::string statistics;  ///< JSON
};
struct FrameSetup {
  uint64_t setup = 0;  ///< tiles name it
  RenderJob job;       ///< with one camera
};
/// A tile handed out under a lease: results under another lease or setup are dropped.
struct TileOrder {
  uint64_t setup = 0;
  uint32_t tile = 0;
  uint64_t lease = 0;
  uint32_t x = 0, y = 0, width = 0, height = 0;
};
struct TileDone {
  uint64_t setup = 0;
  uint32_t tile = 0;
  uint64_t lease = 0;
  uint64_t rays = 0, rays_suspended = 0;
};
/// A worker's counters since it started.
struct Alive {
  uint64_t cache_bytes = 0, voxels_loaded = 0, voxel_bytes_loaded = 0, voxel_bytes_received = 0,
           evictions = 0;
  uint64_t rays = 0, rays_suspended = 0, peak_rss_bytes = 0;
};
struct BlockRequest {
  uint32_t block = 0;
};

/// One function a message: the table's bytes, to be put into Message::table.
Bytes Encode(const Hello& m);
Bytes Encode(const Welcome& m);
Bytes Encode(const Failure& m);
Bytes Encode(const RenderJob& m);
Bytes Encode(const FrameProgress& m);
Bytes Encode(const FrameDone& m);
Bytes Encode(const FrameSetup& m);
Bytes Encode(const TileOrder& m);
Bytes Encode(const TileDone& m);
Bytes Encode(const Alive& m);
Bytes Encode(const BlockRequest& m);

/// And back: verified by FlatBuffers, then every value checked. Errors: one sentence; nothing is believed
/// before.
Result<Hello> DecodeHello(std::span<const std::byte> table);
Result<Welcome> DecodeWelcome(std::span<const std::byte> table);
Result<Failure> DecodeFailure(std::span<const std::byte> table);
Result<RenderJob> DecodeRenderJob(std::span<const std::byte> table);
Result<FrameProgress> DecodeFrameProgress(std::span<const std::byte> table);
Result<FrameDone> DecodeFrameDone(std::span<const std::byte> table);
Result<FrameSetup> DecodeFrameSetup(std::span<const std::byte> table);
Result<TileOrder> DecodeTileOrder(std::span<const std::byte> table);
Result<TileDone> DecodeTileDone(std::span<const std::byte> table);
Result<Alive> DecodeAlive(std::span<const std::byte> table);
Result<BlockRequest> DecodeBlockRequest(std::span<const std::byte> table);

/// A whole message around an encoded table.
template <class T>
Message MakeMessage(MessageType type, const T& content, uint64_t request = 0) {
  return {type, request, Encode(content), {}};
}

}  // namespace quarry
