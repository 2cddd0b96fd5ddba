#include "common/protocol/frame.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/version.h"
#include "common/scene/tile.h"

namespace quarry {
namespace {

constexpr std::string_view kPreambleMagic{"QUARRY\0\0", 8};
constexpr uint32_t kFrameMagic = 0x31595251;  // "QRY1"
constexpr size_t kVersionBytes = 20;

struct Limits {
  uint32_t table, raw;
};

constexpr uint32_t kSmall = 1u << 10;  // limit of tables without lists

Limits LimitsOf(MessageType type) {
  switch (type) {
    case MessageType::kCatalog:
      return {0, 0xF0000000u};
    case MessageType::kRenderJob:
      return {10u << 20, 0};  // kMaxFrames cameras take 9 MiB
    case MessageType::kLeave:
      return {128u << 10, 0};  // kMaxGivenBack
    case MessageType::kFrameSetup:
    case MessageType::kPeers:
      return {1u << 20, 0};
    case MessageType::kWorkerStatus:
      return {16u << 20, 0};
    case MessageType::kFrameDone:
      return {1u << 20, 0xF0000000u};
    case MessageType::kTileDone:
      return {5u << 20, kMaxTileBytes};  // kMaxTileBlocks
    case MessageType::kSelection:
      return {512u << 20, 0};  // three bits and two bytes for each of 2^27 parts
    case MessageType::kEnvironment:
      return {kSmall, 32u << 20};  // 24 bytes a page, and the table
    case MessageType::kBlock:
      return {0, 65u << 20};
    case MessageType::kHello:
    case MessageType::kQuery:
    case MessageType::kFrameProgress:
    case MessageType::kBlockRequest:
    case MessageType::kRay:
    case MessageType::kRayDone:
      return {kSmall, 0};
    case MessageType::kAnswer:
      return {0, 256u << 20};  // names of materials and parts
    case MessageType::kPing:
      return {0, 0};
    default:
      return {64u << 10, 0};
  }
}

bool May(Speaker speaker, MessageType type) {
  using enum MessageType;
  switch (speaker) {
    case Speaker::kStranger:
      return type == kHello;
    case Speaker::kWorker:
      return type == kHello || type == kTileDone || type == kRayDone || type == kWorkerStatus ||
             type == kLeave || type == kFailure || type == kPing;
    case Speaker::kVoxels:
      return type == kBlockRequest || type == kPing;
    case Speaker::kClient:
      return type == kRenderJob || type == kQuery || type == kPing;
    case Speaker::kMasterOfWorkers:
      return type == kWelcome || type == kCatalog || type == kSelection || type == kEnvironment ||
             type == kFrameSetup || type == kTile || type == kRay || type == kPeers || type == kFramesEnd ||
             type == kFailure || type == kFarewell || type == kPing;
    case Speaker::kMasterOfClients:
      return type == kWelcome || type == kFrameProgress || type == kFrameDone || type == kAnswer ||
             type == kFailure || type == kFarewell || type == kPing;
    case Speaker::kVoxelServer:
      return type == kWelcome || type == kBlock || type == kFailure || type == kPing;
    case Speaker::kAnyone:
      return true;
  }
  return false;
}

}  // namespace

Bytes EncodePreamble(uint32_t protocol, const std::string& version) {
  ByteWriter out;
  out.PutArray(kPreambleMagic);
  out.Put(protocol);
  std::string text = version.empty() ? kVersion : version;
  text.resize(kVersionBytes);
  out.PutArray(text);
  return out.Take();
}

Status CheckPreamble(std::span<const std::byte> bytes) {
  ByteReader in(bytes);
  const auto magic = in.GetSpan(kPreambleMagic.size());
  const auto protocol = in.Get<uint32_t>();
  const auto text = AsText(in.GetSpan(kVersionBytes));
  if (!in.done() || AsText(magic) != kPreambleMagic) return Fail("the other side is not a Quarry program");
  if (protocol == kProtocolVersion) return {};
  std::string version(text.substr(0, text.find('\0')));
  std::replace_if(
      version.begin(), version.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return Fail(
      fmt::format("this is Quarry {} with protocol {}, the other side is Quarry {} with protocol {}: use the "
                  "same version everywhere",
                  kVersion, kProtocolVersion, version, protocol));
}

Bytes EncodeFrameHeader(const Message& message) {
  ByteWriter out;
  out.Put(kFrameMagic);
  out.Put(static_cast<uint16_t>(message.type));
  out.Put(uint16_t{0});
  out.Put(message.request);
  out.Put(static_cast<uint32_t>(message.table.size()));
  out.Put(static_cast<uint32_t>(message.raw.size()));
  out.Put(Checksum(message.table, message.raw));
  out.Put(Checksum(out.bytes()));
  return out.Take();
}

Result<FrameHeader> DecodeFrameHeader(std::span<const std::byte> bytes, Speaker speaker) {
  ByteReader in(bytes);
  const auto magic = in.Get<uint32_t>();
  const auto type = in.Get<uint16_t>();
  const auto reserved = in.Get<uint16_t>();
  FrameHeader header{};
  header.request = in.Get<uint64_t>();
  header.table_bytes = in.Get<uint32_t>();
  header.raw_bytes = in.Get<uint32_t>();
  header.checksum = in.Get<uint64_t>();
  const auto own_checksum = in.Get<uint64_t>();
  if (!in.done() || magic != kFrameMagic || reserved != 0)
    return Fail("received bytes that are not a Quarry message");
  if (Checksum(bytes.first(kFrameHeaderBytes - sizeof own_checksum)) != own_checksum)
    return Fail("received a message that was damaged on its way (checksum of its header)");
  if (type == 0 || type >= kMessageTypes)
    return Fail(fmt::format("received a message of unknown type {}", type));
  header.type = static_cast<MessageType>(type);
  if (!May(speaker, header.type))
    return Fail(speaker == Speaker::kStranger
                    ? fmt::format("began with a message of type {}, which is not a greeting", type)
                    : fmt::format("received a message of type {}, which is not allowed here", type));
  const Limits limits = LimitsOf(header.type);
  if (header.table_bytes > limits.table || header.raw_bytes > limits.raw)
    return Fail(fmt::format("received a message of type {} beyond its size limit", type));
  return header;
}

Status CheckContent(const FrameHeader& header, const Message& message) {
  if (Checksum(message.table, message.raw) == header.checksum) return {};
  return Fail(fmt::format("received a message of type {} that was damaged on its way (checksum)",
                          static_cast<int>(header.type)));
}

}  // namespace quarry
