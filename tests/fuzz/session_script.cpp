#include "tests/fuzz/session_script.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <utility>

namespace quarry::fuzz {

uint32_t Script::Number() {
  const uint8_t first = Byte();
  if (first < 224) return first % 8;
  uint32_t number = 0;
  for (int i = 0; i < 4; ++i) number = number << 8 | Byte();
  return number;
}

std::string Script::Text() {
  std::string text;
  for (uint32_t n = Below(24); n > 0; --n) text += static_cast<char>(Byte());
  return text;
}

Bytes Script::Some() {
  Bytes bytes;
  for (uint32_t n = Byte(); n > 0 && !over(); --n) bytes.push_back(static_cast<std::byte>(Byte()));
  return bytes;
}

const std::string& StorePath() {
  static const std::string path = [] {
    const char* given = std::getenv("QUARRY_FUZZ_STORE");
    return std::string(given ? given : "");
  }();
  return path;
}

StoreReader& Store() {
  static StoreReader store = [] {
    auto opened = StoreReader::Open(StorePath());
    if (opened) return std::move(*opened);
    std::fprintf(stderr, "QUARRY_FUZZ_STORE names no store: %s\n", opened.error().message.c_str());
    std::exit(1);
  }();
  return store;
}

RenderJob AnyJob(Script& script) {
  constexpr uint32_t kSides[] = {1, 16, 33, 64};
  RenderJob job;
  job.view.width = kSides[script.Below(4)];
  job.view.height = kSides[script.Below(4)];
  if (script.Below(4) == 0) {
    job.view.crop = {script.Below(8), 0, 0, 0};
    job.view.crop.width = script.Number();
    job.view.crop.height = script.Number();
  }
  job.view.mode = static_cast<RenderMode>(script.Below(kRenderModes));
  job.view.spp = 1 + script.Below(2);
  job.view.seed = script.Below(3);
  job.format.exposure = script.Number();
  job.view.aov_mask = script.Byte() & 127;
  job.format.name = script.Below(2) ? "png" : "exr";
  job.first_frame = script.Number();
  for (uint32_t lights = script.Below(3); lights > 0; --lights)
    job.view.lights.push_back(
        {static_cast<LightKind>(script.Below(2)), {1, 2, static_cast<float>(script.Number())}, {1, 1, 1}});
  const SceneMeta& scene = Store().catalog().meta;
  const glm::dvec3 lower(scene.bounds_lower), upper(scene.bounds_upper), middle = (lower + upper) * 0.5;
  for (uint32_t frames = 1 + script.Below(3); frames > 0; --frames) {
    const glm::dvec3 from(script.Byte() / 64.0 - 2, script.Byte() / 64.0 - 2, 0.3);
    job.cameras.push_back({middle + (upper - lower) * from, middle, {0, 0, 1}});
  }
  return job;
}

namespace {

TileOrder AnyTileOrder(Script& script) {
  TileOrder order{script.Number(), script.Number(), script.Number()};
  order.area = {{script.Number(), script.Number(), script.Number(), script.Number()}};
  if (script.Below(2)) order.area.step = script.Number();
  if (script.Below(2)) order.area.phase_x = script.Number();
  if (script.Below(2)) order.area.phase_y = script.Number();
  order.area.first_sample = script.Below(3);
  order.area.samples = script.Below(3);
  order.area.form = static_cast<PixelForm>(script.Below(4));
  order.area.leaves_holes = script.Below(2);
  order.urgency = static_cast<Urgency>(script.Below(4));
  order.blocks = {script.Number()};
  order.holders = {script.Number()};
  return order;
}

Bytes AnyTable(Script& script) {
  switch (script.Below(17)) {
    case 0:
      return Encode(Hello{static_cast<Role>(script.Below(4)), script.Text(), script.Number(), script.Number(),
                          static_cast<uint16_t>(script.Number())});
    case 1:
      return Encode(Welcome{Store().catalog().id, script.Number(), {"master"}});
    case 2:
      return Encode(Failure{script.Text()});
    case 3:
      return Encode(JobRequest{AnyJob(script), script.Number()});
    case 4:
      return Encode(FrameProgress{script.Number(), script.Number(), script.Number(), script.Number()});
    case 5:
      return Encode(FrameDone{script.Number(), script.Text()});
    case 6:
      return Encode(FrameSetup{script.Number(), FrameView(AnyJob(script)), script.Number()});
    case 7:
      return Encode(AnyTileOrder(script));
    case 8:
      return Encode(TileDone{script.Number(),
                             script.Number(),
                             script.Number(),
                             script.Number(),
                             script.Number(),
                             script.Number(),
                             std::vector<float>(script.Below(70), 1.0f),
                             {script.Number()}});
    case 9:
      return Encode(Peers{{script.Number(), script.Number()}, {"127.0.0.1:1", script.Text()}});
    case 10: {
      WorkerStatus alive;
      alive.whole = script.Below(2) == 0;
      alive.voxel_bytes_received = script.Number();
      alive.fetch_us = script.Number();
      alive.decode_us = script.Number();
      for (uint32_t n = script.Below(8); n > 0; --n) alive.cached.push_back(script.Number());
      for (uint32_t n = script.Below(8); n > 0; --n) alive.dropped.push_back(script.Number());
      return Encode(alive);
    }
    case 11:
      return Encode(BlockRequest{script.Number()});
    case 12:
      return {};
    case 13:
      return Encode(FramesEnd{{script.Number(), script.Number()}});
    case 14:
      return Encode(Leave{{script.Number(), 1}, {script.Number(), script.Number()}, script.Below(2) == 0});
    case 15:
      return Encode(
          RayOrder{script.Number(),
                   script.Number(),
                   {{script.Number(), 0, 0}, {script.Number() - 100.0, 1, script.Below(3) - 1.0}, 1e9}});
    case 16:
      return Encode(RayDone{script.Number(), script.Number(), script.Below(9) - 1.0f, script.Number(),
                            script.Number(), script.Number()});
    default:
      return script.Some();
  }
}

bool Small(const View& view) { return uint64_t{view.crop.width} * view.crop.height * view.spp <= 1 << 14; }

/// See AnyMessage.
bool Harmless(const Message& m) {
  if (m.type == MessageType::kRenderJob) {
    const auto request = DecodeJobRequest(m.table);
    return !request || (Small(request->job.view) && request->job.cameras.size() <= 8);
  }
  if (m.type == MessageType::kFrameSetup) {
    const auto setup = DecodeFrameSetup(m.table);
    return !setup || Small(setup->view);
  }
  if (m.type == MessageType::kWelcome) {
    const auto welcome = DecodeWelcome(m.table);
    return !welcome || welcome->sources == std::vector<std::string>{"master"};
  }
  return true;
}

}  // namespace

Message AnyMessage(Script& script) {
  Message m{
      static_cast<MessageType>(1 + script.Below(kMessageTypes - 1)), script.Number(), AnyTable(script), {}};
  if (script.Below(4) == 0) m.raw = script.Some();
  return Harmless(m) ? m : Message{MessageType::kPing, 0, {}, {}};
}

void NeverEnds(const char* what) {
  std::fprintf(stderr, "never ends: %s\n", what);
  std::abort();
}

}  // namespace quarry::fuzz

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  (void)quarry::fuzz::Store();
  const char* folder = std::getenv("QUARRY_WRITE_SEEDS");
  if (!folder) return 0;
  const auto seeds = quarry::fuzz::Seeds();
  for (size_t i = 0; i < seeds.size(); ++i) {
    std::ofstream file(folder + ("/seed-" + std::to_string(i)), std::ios::binary);
    file.write(reinterpret_cast<const char*>(seeds[i].data()), static_cast<std::streamsize>(seeds[i].size()));
  }
  std::exit(0);
}
