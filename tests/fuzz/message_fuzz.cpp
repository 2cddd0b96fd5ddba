// Reads the bytes as the kind of message that the first byte names. An accepted message must be the same
// after it is encoded and read again. With QUARRY_WRITE_SEEDS=FOLDER it writes a well-formed message of each
// kind there, and ends.
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "common/protocol/messages.h"
#include "tests/support/cluster/shared_tables.h"

namespace {

using namespace quarry;

/// Decodes; an accepted message, encoded, must be accepted again and encode to the same bytes.
template <class Decode>
void Read(std::span<const std::byte> bytes, Decode decode) {
  const auto message = decode(bytes);
  if (!message) {
    if (message.error().message.empty()) std::abort();
    return;
  }
  const Bytes once = Encode(*message);
  const auto again = decode(once);
  if (!again || Encode(*again) != once) std::abort();
}

void ReadFrame(std::span<const std::byte> bytes) {
  (void)CheckPreamble(bytes.first(std::min(bytes.size(), kPreambleBytes)));
  if (bytes.size() < kFrameHeaderBytes) return;
  // The checksum is made right: guessing it is no test.
  Bytes header(bytes.begin(), bytes.begin() + kFrameHeaderBytes);
  const uint64_t checksum = Checksum(std::span(header).first(kFrameHeaderBytes - sizeof checksum));
  std::memcpy(header.data() + kFrameHeaderBytes - sizeof checksum, &checksum, sizeof checksum);
  (void)DecodeFrameHeader(header);
}

void ReadCatalog(std::span<const std::byte> bytes) {
  const auto sections = UnpackSections(bytes);
  if (sections) (void)DecodeCatalog(SceneId{}, *sections);
}

constexpr int kKinds = 20;

void ReadAs(int kind, std::span<const std::byte> bytes) {
  switch (kind) {
    case 0:
      return Read(bytes, DecodeHello);
    case 1:
      return Read(bytes, DecodeWelcome);
    case 2:
      return Read(bytes, DecodeFailure);
    case 3:
      return Read(bytes, DecodeJobRequest);
    case 4:
      return Read(bytes, DecodeFrameProgress);
    case 5:
      return Read(bytes, DecodeFrameDone);
    case 6:
      return Read(bytes, DecodeFrameSetup);
    case 7:
      return Read(bytes, DecodeTileOrder);
    case 8:
      return Read(bytes, DecodeTileDone);
    case 9:
      return Read(bytes, DecodePeers);
    case 10:
      return Read(bytes, DecodeWorkerStatus);
    case 11:
      return Read(bytes, DecodeBlockRequest);
    case 12:
      return ReadFrame(bytes);
    case 14:
      return Read(bytes, DecodeQuery);
    case 15:
      return Read(bytes, DecodeFramesEnd);
    case 16:
      return Read(bytes, DecodeLeave);
    case 17:
      return Read(bytes, DecodeRayOrder);
    case 18:
      return Read(bytes, DecodeRayDone);
    case 19:
      return Read(bytes, DecodeSelection);
    default:
      return ReadCatalog(bytes);
  }
}

RenderJob SmallJob() {
  RenderJob job;
  job.view.width = job.view.height = 64;
  job.view.crop = {0, 0, 64, 64};
  job.view.lights.push_back({LightKind::kPoint, {1, 2, 3}, {4, 5, 6}});
  job.view.parts.lists = std::make_shared<const PartLists>(
      PartLists{{"a/b"}, std::vector<std::string>{"a"}, {{{"a/c"}, glm::vec3(1, 0, 0)}}});
  job.view.section = {true, {0, 0, 0}, {1, 1, 1}, {{{0, 0, 0}, {0, 0, 1}}}, true};
  job.cameras.push_back({{0, 0, 5}, {0, 0, 0}, {0, 1, 0}});
  return job;
}

PartSelection SmallSelection() {
  return {.id = 1,
          .hidden = {5},
          .voxels = {{}, {}},
          .closed = {1},
          .inverted = {0},
          .colors = {{1, 0, 0}},
          .color_of = {1, 0}};
}

void WriteSeeds(const std::string& folder) {
  const Message framed{MessageType::kBlock, 3, {}, Bytes(9)};
  WorkerStatus alive;
  alive.cached = {1, 2, 5};
  alive.dropped = {4};
  const std::vector<Bytes> seeds = {Encode(Hello{Role::kWorker, "worker", 2, 77, 9000}),
                                    Encode(Welcome{SceneId{}, 3, {"master", "127.0.0.1:9001"}}),
                                    Encode(Failure{"a sentence"}),
                                    Encode(JobRequest{SmallJob(), 0}),
                                    Encode(FrameProgress{1, 2, 3, 4}),
                                    Encode(FrameDone{1, "{}"}),
                                    Encode(FrameSetup{5, FrameView(SmallJob()), 4}),
                                    Encode(TileOrder{5, 1, 2, {{0, 0, 32, 32}}, {7, 8}, {0, 3}}),
                                    Encode(TileDone{5, 1, 2, 100, 10, 50, {1.5f}, {7, 8}}),
                                    Encode(Peers{{1, 2}, {"127.0.0.1:1", "127.0.0.1:2"}}),
                                    Encode(alive),
                                    Encode(BlockRequest{12}),
                                    EncodeFrameHeader(framed),
                                    PackSections({}),
                                    Encode(Query{kStatusTopic}),
                                    Encode(FramesEnd{{5, 6}}),
                                    Encode(Leave{{5}, {2}, true}),
                                    Encode(RayOrder{3, 1, {{1, 2, 3}, {0, 0, -1}, 100}}),
                                    Encode(RayDone{3, 1, 2.5f, 7, 1, 6}),
                                    Encode(SmallSelection())};
  const auto write = [&](const std::string& name, size_t kind, const Bytes& bytes) {
    std::ofstream file(folder + "/" + name, std::ios::binary);
    file.put(static_cast<char>(kind));
    file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  };
  for (size_t kind = 0; kind < seeds.size(); ++kind) write("kind-" + std::to_string(kind), kind, seeds[kind]);
  // Large ones: cameras and strings that are one, named many times.
  write("shared-cameras", 3, test::SharedCameras(60000, 15000));
  write("shared-sources", 1, test::SharedSources(60000, 60000));
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  if (const char* folder = std::getenv("QUARRY_WRITE_SEEDS")) {
    WriteSeeds(folder);
    std::exit(0);
  }
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  // A copy of its own: reading past its end is found out.
  const auto* bytes = reinterpret_cast<const std::byte*>(data);
  ReadAs(data[0] % kKinds, Bytes(bytes + 1, bytes + size));
  return 0;
}
