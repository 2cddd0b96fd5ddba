#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/status.h"

// Bytes on the wire, whatever carries them. PROTOCOL.md gives them one by one.

namespace quarry {

/// Moves freely until the first release; programs of different protocol versions do not talk.
inline constexpr uint32_t kProtocolVersion = 7;

/// Each side's first bytes, of one layout for good: "QUARRY\0\0", protocol version (4), the program's version
/// as zero-padded text (20).
inline constexpr size_t kPreambleBytes = 32;
Bytes EncodePreamble(uint32_t protocol = kProtocolVersion, const std::string& version = {});
/// Errors: not Quarry at all; another protocol version (a sentence that names both).
Status CheckPreamble(std::span<const std::byte> bytes);

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
  kPing,  ///< nothing in it: the sender lives
};
inline constexpr uint16_t kMessageTypes = 16;  ///< one past the last

/// Masters, workers and clients send something at least so often, and take for lost who sends not a byte for
/// so long.
inline constexpr double kHeartbeatS = 1, kSilenceS = 6;

struct Message {
  MessageType type = MessageType::kFailure;
  uint64_t request = 0;  ///< an answer carries its question's
  Bytes table;           ///< a FlatBuffer, see messages.fbs; may be empty
  Bytes raw;
};

/// Before each message: "QRY1", type (2), zero (2), request (8), table bytes (4), raw bytes (4), checksum of
/// table and raw (8), checksum of the 32 bytes before (8). A byte that changed on its way is noticed whatever
/// it belongs to; a changed length before it is waited for.
inline constexpr size_t kFrameHeaderBytes = 40;
struct FrameHeader {
  MessageType type;
  uint64_t request;
  uint32_t table_bytes, raw_bytes;
  uint64_t checksum;  ///< of table and raw
};
Bytes EncodeFrameHeader(const Message& message);
/// Who is at the other end, as far as this side knows: which messages may come, and how large they may be.
enum class Speaker : uint8_t {
  kAnyone,    ///< every type, by the type's own limit
  kStranger,  ///< has connected and not greeted
  kWorker,    ///< these three have greeted whoever listens, by their Role
  kVoxels,
  kClient,
  kMasterOfWorkers,  ///< these three answer whoever has connected
  kMasterOfClients,
  kVoxelServer,
};
/// Errors: not a frame, damaged, an unknown type, a type that is not for `speaker` to send, a size beyond
/// that type's limit. Nothing may be allocated before this.
Result<FrameHeader> DecodeFrameHeader(std::span<const std::byte> bytes, Speaker speaker = Speaker::kAnyone);
/// Whether table and raw are those that the header was made for. Error: they are not.
Status CheckContent(const FrameHeader& header, const Message& message);

}  // namespace quarry
