#include "preprocess/import/gltf/draco/draco_decoder.h"

#include <fmt/format.h>
#include <sys/wait.h>

#include <algorithm>
#include <csignal>

#include "common/base/bytes.h"
#include "common/base/descriptor.h"
#include "preprocess/import/foreign/child_environment.h"

namespace quarry {
namespace {

constexpr size_t kPieceBytes = 1 << 20;
constexpr const char* kWithout = "export the model without KHR_draco_mesh_compression";

/// 0: no type that the helper sends.
uint64_t SizeOf(uint32_t component_type) {
  switch (component_type) {
    case 5120:
    case 5121:
      return 1;
    case 5122:
    case 5123:
      return 2;
    case 5125:
    case 5126:
      return 4;
    default:
      return 0;
  }
}

}  // namespace

uint64_t DracoFacts::Attribute::value_bytes() const { return components * SizeOf(component_type); }

/// The helper has ended; the result is the reason.
tl::unexpected<Error> DracoDecoder::Ended() {
  const int status = helper_.Wait();
  if (WIFEXITED(status) && WEXITSTATUS(status) == kNoLibrary)
    return Fail(fmt::format("{} lacks shared libraries: install Draco (Debian's package libdraco7), or {}",
                            helper_.program(), kWithout));
  if (WIFEXITED(status))
    return Fail(fmt::format("the process that decodes it, {}, has ended before its answer (status {})",
                            helper_.program(), WEXITSTATUS(status)));
  const int signal = WTERMSIG(status);
  if (signal == SIGXCPU) return Fail(fmt::format("takes its decoder more than ten minutes; {}", kWithout));
  // The kernel kills so when memory is short, and so do people: the mesh is not at fault.
  if (signal == SIGKILL || signal == SIGTERM || signal == SIGINT || signal == SIGHUP)
    return Fail(fmt::format("the process that decodes it was ended by signal {}", signal));
  return Fail(fmt::format("the decoder has crashed on it: it is damaged; {}", kWithout));
}

Status DracoDecoder::Ask(uint64_t bytes, const ReadPiece& read, std::span<const uint32_t> ids) {
  if (helper_.program().empty())
    return Fail(
        fmt::format("needs quarry-import-draco, which is not installed with this program; {}", kWithout));
  QUARRY_TRY(helper_.Start());
  ByteWriter request;
  request.Put(bytes);
  request.Put(static_cast<uint32_t>(ids.size()));
  request.PutArray(ids);
  if (!WriteAll(helper_.to(), request.bytes())) return Ended();
  Bytes piece;
  for (uint64_t at = 0; at < bytes; at += piece.size()) {
    piece.resize(std::min<uint64_t>(bytes - at, kPieceBytes));
    QUARRY_TRY(read(at, piece));
    // A helper that is short of memory answers before it has read all, and ends.
    if (!WriteAll(helper_.to(), piece)) break;
  }
  return {};
}

Result<DracoFacts> DracoDecoder::ReceiveFacts(size_t attributes) {
  std::byte header[kDracoAnswerBytes];
  if (!ReadAll(helper_.from(), header)) return Ended();
  ByteReader head(header);
  const auto answer = static_cast<DracoAnswer>(head.Get<uint32_t>());
  Bytes bytes(std::min(head.Get<uint32_t>(), kMostDracoFacts));
  if (!ReadAll(helper_.from(), bytes)) return Ended();
  if (answer == DracoAnswer::kTooLarge)
    return Fail(fmt::format("needs more memory to be decoded than --memory, or is damaged; give more, or {}",
                            kWithout));
  if (answer == DracoAnswer::kNewer)
    return Fail(fmt::format("is of a version of Draco's format that the installed libdraco does not read; {}",
                            kWithout));
  if (answer == DracoAnswer::kRefused) {
    std::string why(AsText(bytes));
    while (why.ends_with('.')) why.pop_back();
    return Fail(fmt::format("cannot be decoded ({}); export the model again", why));
  }
  ByteReader in(bytes);
  DracoFacts facts;
  facts.points = in.Get<uint64_t>();
  facts.corners = in.Get<uint64_t>();
  bool sound = answer == DracoAnswer::kMesh && facts.points <= 0xFFFFFFFF && facts.corners / 3 <= 0xFFFFFFFF;
  for (size_t i = 0; i < attributes; ++i) {
    DracoFacts::Attribute attribute;
    attribute.component_type = in.Get<uint32_t>();
    attribute.components = in.Get<uint32_t>();
    attribute.normalized = in.Get<uint32_t>() != 0;
    sound &= SizeOf(attribute.component_type) != 0 && attribute.components - 1 < 4;
    facts.attributes.push_back(attribute);
  }
  // A decoder that was misled by its input may send anything.
  if (!sound || !in.done()) return Fail(fmt::format("the decoder gives an invalid answer; {}", kWithout));
  return facts;
}

Status DracoDecoder::Receive(uint64_t bytes, const OnPiece& piece) {
  Bytes part;
  for (uint64_t at = 0; at < bytes; at += part.size()) {
    part.resize(std::min<uint64_t>(bytes - at, kPieceBytes));
    if (!ReadAll(helper_.from(), part)) return Ended();
    QUARRY_TRY(piece(part));
  }
  return {};
}

Result<DracoFacts> DracoDecoder::Decode(uint64_t bytes, const ReadPiece& read, std::span<const uint32_t> ids,
                                        const OnPiece& piece) {
  const auto decode = [&]() -> Result<DracoFacts> {
    QUARRY_TRY(Ask(bytes, read, ids));
    QUARRY_ASSIGN(DracoFacts facts, ReceiveFacts(ids.size()));
    QUARRY_TRY(Receive(facts.corners * sizeof(uint32_t), piece));
    for (const DracoFacts::Attribute& attribute : facts.attributes)
      QUARRY_TRY(Receive(facts.points * attribute.value_bytes(), piece));
    return facts;
  };
  Result<DracoFacts> facts = decode();
  if (!facts) helper_.Stop();  // bytes may be in flight
  return facts;
}

}  // namespace quarry
