#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/status.h"

// The bytes of the protocol, independent of the transport. PROTOCOL.md gives them one by one. Thread-safe:
// functions use only their arguments. All numbers are little-endian, all sizes are bytes.

namespace quarry {

/// The version of the protocol. Programs of different versions refuse each other; it may change freely until
/// the first release.
inline constexpr uint32_t kProtocolVersion = 21;

/// The preamble, the first bytes of each side. Its layout never changes: "QUARRY\0\0" (8), protocol version
/// (4), the program's version as zero-padded text (20).
inline constexpr size_t kPreambleBytes = 32;
Bytes EncodePreamble(uint32_t protocol = kProtocolVersion, const std::string& version = {});
/// Errors: not a preamble of Quarry; another protocol version, in a sentence that names both.
Status CheckPreamble(std::span<const std::byte> bytes);

/// Types of messages; PROTOCOL.md names the sender of each.
enum class MessageType : uint16_t {
  kHello = 1,
  kWelcome,
  kFailure,
  kCatalog,  ///< raw: the scene's packed sections
  kRenderJob,
  kFrameProgress,
  kFrameDone,  ///< raw: the image file
  kFrameSetup,
  kTile,
  kTileDone,  ///< raw: pixels
  kWorkerStatus,
  kBlockRequest,
  kBlock,  ///< raw: the stored block
  kPeers,
  kPing,    ///< empty; shows that the sender lives
  kQuery,   ///< of a client
  kAnswer,  ///< raw: JSON
  kFramesEnd,
  kLeave,
  kFarewell,  ///< a Failure after which the master may be reached again
  kRay,
  kRayDone,
  kSelection,
  kEnvironment,  ///< raw: the packed sections of an environment's store
};
inline constexpr uint16_t kMessageTypes = 25;  ///< one past the last

/// Seconds. Masters, workers and clients send a message at least every kHeartbeatS, and drop a peer that
/// sends no byte for kSilenceS. Trades the time until a dead peer is noticed against dropping a peer whose
/// machine is busy or whose messages are delayed. A judgement: silence lasts six heartbeats.
inline constexpr double kHeartbeatS = 1, kSilenceS = 6;

/// A message in memory.
struct Message {
  MessageType type = MessageType::kFailure;
  uint64_t request = 0;  ///< an answer has its request's number
  Bytes table;           ///< a FlatBuffer of messages.fbs, or empty
  Bytes raw;
};

/// The header before each message: "QRY1" (4), type (2), zero (2), request (8), table bytes (4), raw bytes
/// (4), checksum of table and raw (8), checksum of the 32 bytes before (8). The second checksum finds a
/// damaged length before the receiver waits for so many bytes.
inline constexpr size_t kFrameHeaderBytes = 40;
struct FrameHeader {
  MessageType type;
  uint64_t request;
  uint32_t table_bytes, raw_bytes;
  uint64_t checksum;  ///< of table and raw
};
Bytes EncodeFrameHeader(const Message& message);
/// The peer as far as this side knows it. Decides the messages that may come.
enum class Speaker : uint8_t {
  kAnyone,           ///< may send every type
  kStranger,         ///< connected, and has sent no Hello
  kWorker,           ///< sent a Hello with Role::kWorker
  kVoxels,           ///< sent a Hello with Role::kVoxels
  kClient,           ///< sent a Hello with Role::kClient
  kMasterOfWorkers,  ///< accepted a worker's connection
  kMasterOfClients,  ///< accepted a client's connection
  kVoxelServer,      ///< accepted the connection of a Role::kVoxels
};
/// Decodes and checks a header; nothing may be allocated for the message before.
/// Shapes: bytes[kFrameHeaderBytes].
/// Errors: not a frame; damaged; an unknown type; a type that `speaker` may not send; a size beyond the
/// type's limit.
Result<FrameHeader> DecodeFrameHeader(std::span<const std::byte> bytes, Speaker speaker = Speaker::kAnyone);
/// Checks the checksum of table and raw. Errors: it differs from the header's.
Status CheckContent(const FrameHeader& header, const Message& message);

}  // namespace quarry
