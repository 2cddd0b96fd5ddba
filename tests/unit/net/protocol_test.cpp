#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <functional>
#include <random>

#include "common/protocol/messages.h"
#include "common/scene/sky/atmosphere.h"

namespace quarry {
namespace {

RenderJob MakeJob() {
  RenderJob job;
  job.view.width = 640;
  job.view.height = 480;
  job.view.crop = {1, 2, 300, 200};
  job.view.mode = RenderMode::kWhitted;
  job.view.spp = 16;
  job.view.seed = 0x123456789ABCDEFull;
  job.format.exposure = -1.5;
  job.view.aov_mask = 0x55;
  job.format.name = "exr";
  job.view.lights = {{LightKind::kPoint, {1, 2, 3}, {4, 5, 6}, {0, 1, 0}, 2.5f, -1.25f},
                     {LightKind::kSun, {0, 0, 1}, {1, 1, 1}},
                     {LightKind::kRectangle, {1, 2, 3}, {9, 8, 7}}};
  job.view.lights[1].angle = 7.5f;
  job.view.lights[2].edges[0] = {1, 0, 0.5f};
  job.view.lights[2].edges[1] = {0, 2, 0};
  job.view.bounces = 3;
  job.view.meters = true;
  job.view.lights.push_back({LightKind::kPoint, {0, -1, 0}, {1, 1, 1}});  // where a camera is by default
  job.view.lights[3].at_eye = true;
  job.view.range = -17;
  job.format.tone = ToneCurve::kFilm;
  job.view.sky = {{0.1f, 0.2f, 0.3f}, 4};
  job.view.ambient = {0.1f, 0.2f, 0.3f};
  job.view.background = {0.4f, 0.5f, 0.6f};
  job.view.backdrop = false;
  job.cameras = {{{1, 2, 3}, {4, 5, 7}, {0, 1, 0}, 33.5, 0}, {{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, 60, 12.5}};
  job.first_frame = 7;
  return job;
}

void CheckSame(const CameraSpec& a, const CameraSpec& b) {
  CHECK(a.eye == b.eye);
  CHECK(a.at == b.at);
  CHECK(a.up == b.up);
  CHECK(a.fov_degrees == b.fov_degrees);
  CHECK(a.ortho_height == b.ortho_height);
}

void CheckSame(const View& a, const View& b) {
  CHECK(a.width == b.width);
  CHECK(a.height == b.height);
  CHECK(a.crop == b.crop);
  CHECK(a.mode == b.mode);
  CHECK(a.spp == b.spp);
  CHECK(a.seed == b.seed);
  CHECK(a.aov_mask == b.aov_mask);
  CHECK(a.ambient == b.ambient);
  CHECK(a.background == b.background);
  CHECK(a.backdrop == b.backdrop);
  CHECK((a.bounces == b.bounces && a.sky == b.sky && a.range == b.range && a.meters == b.meters));
  CHECK(a.lights == b.lights);
  CheckSame(a.camera, b.camera);
}

void CheckSame(const RenderJob& a, const RenderJob& b) {
  CheckSame(a.view, b.view);
  CHECK(a.format.name == b.format.name);
  CHECK(a.format.exposure == b.format.exposure);
  CHECK(a.format.tone == b.format.tone);
  CHECK(a.first_frame == b.first_frame);
  REQUIRE(a.cameras.size() == b.cameras.size());
  for (size_t i = 0; i < a.cameras.size(); ++i) CheckSame(a.cameras[i], b.cameras[i]);
}

}  // namespace

TEST_CASE("A worker greets with at least one thread; others have none") {
  CHECK_FALSE(DecodeHello(Encode(Hello{Role::kWorker, "w", 0})).has_value());
  CHECK(DecodeHello(Encode(Hello{Role::kWorker, "w", 1}))->threads == 1);
  CHECK(DecodeHello(Encode(Hello{Role::kClient, "c", 0})).has_value());
}

TEST_CASE("Messages are decoded to the same fields") {
  CheckSame(MakeJob(), DecodeJobRequest(Encode(JobRequest{MakeJob(), 0}))->job);
  const View view = FrameView(MakeJob(), 1);
  const auto setup = DecodeFrameSetup(Encode(FrameSetup{99, view, 98}));
  REQUIRE(setup.has_value());
  CHECK((setup->frame == 99 && setup->oldest == 98));
  CheckSame(view, setup->view);
  const auto hello = DecodeHello(Encode(Hello{Role::kClient, "me", 5}));
  CHECK((hello->role == Role::kClient && hello->name == "me" && hello->threads == 5));
  CHECK(hello->previous_end.empty());
  Hello again{Role::kWorker, "w", 1, 7, 9000, "killed by signal 9"};
  CHECK(DecodeHello(Encode(again))->previous_end == "killed by signal 9");
  again.previous_end = "\33[2J";
  CHECK(DecodeHello(Encode(again))->previous_end == "?[2J");
  again.previous_end = std::string(257, 'x');
  CHECK_FALSE(DecodeHello(Encode(again)).has_value());
  Welcome w;
  w.scene_id = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
  w.worker = 17;
  const auto welcome = DecodeWelcome(Encode(w));
  CHECK((welcome->scene_id == w.scene_id && welcome->worker == 17));
  CHECK(DecodeFailure(Encode(Failure{"a sentence"}))->message == "a sentence");
  CHECK(DecodeFailure(Encode(Failure{"\33[2Ja\nb\xc3\xa4"}))->message == "?[2Ja?b\xc3\xa4");
  CHECK_FALSE(DecodeFailure(Encode(Failure{""})).has_value());
  for (const auto& [given, name] :
       {std::pair("J\xc3\xbcrgen \xe2\x82\xac", "J\xc3\xbcrgen \xe2\x82\xac"), std::pair("a\xff\xc3", "a??"),
        std::pair("\xed\xa0\x80|\xc0\xaf", "???|??"),
        std::pair("\xc2\x9b"
                  "2J\x7f",
                  "??2J?")})
    CHECK(DecodeHello(Encode(Hello{Role::kWorker, given, 1}))->name == name);
  const auto progress = DecodeFrameProgress(Encode(FrameProgress{1, 2, 3, 4}));
  CHECK(
      (progress->frame == 1 && progress->tiles_done == 2 && progress->tiles == 3 && progress->workers == 4));
  const auto frame = DecodeFrameDone(Encode(FrameDone{6, "{}"}));
  CHECK((frame->frame == 6 && frame->statistics == "{}"));
  const auto tile = DecodeTileOrder(Encode(TileOrder{1, 2, 3, {{4, 5, 6, 7}}}));
  CHECK((tile->frame == 1 && tile->tile == 2 && tile->lease == 3 &&
         tile->area.pixels == PixelRect{4, 5, 6, 7} && tile->area.step == 1 &&
         tile->urgency == Urgency::kJob && tile->area.phase_x == Tile::kMiddle &&
         tile->area.form == PixelForm::kMeans));
  TileOrder live{1, 2, 3, {{4, 5, 6, 7}, 4, 2, 0, 1, 3, PixelForm::kSums}, {}, {}, Urgency::kRest};
  live.area.leaves_holes = true;
  const auto seen = DecodeTileOrder(Encode(live));
  CHECK((seen->urgency == Urgency::kRest && seen->area.leaves_holes && seen->area.step == 4 &&
         seen->area.phase_x == 2 && seen->area.phase_y == 0 && seen->area.first_sample == 1 &&
         seen->area.samples == 3 && seen->area.form == PixelForm::kSums));
  CHECK(DecodeFramesEnd(Encode(FramesEnd{{7, 8}}))->frames == std::vector<uint64_t>{7, 8});
  const auto leave = DecodeLeave(Encode(Leave{{7, 8}, {9, 10}, true}));
  CHECK((leave->frames == std::vector<uint64_t>{7, 8} && leave->leases == std::vector<uint64_t>{9, 10} &&
         leave->last));
  const auto done = DecodeTileDone(Encode(TileDone{1, 2, 3, 4, 5}));
  CHECK((done->frame == 1 && done->tile == 2 && done->lease == 3 && done->rays == 4 &&
         done->rays_suspended == 5));
  const auto ray = DecodeRayOrder(Encode(RayOrder{5, 6, {{1, 2, 3}, {0, -0.5, 0}, 7}}));
  CHECK((ray->ray == 5 && ray->lease == 6 && ray->query.origin == glm::dvec3(1, 2, 3) &&
         ray->query.direction == glm::dvec3(0, -0.5, 0) && ray->query.end == 7));
  const auto hit = DecodeRayDone(Encode(RayDone{5, 6, 1.5f, 7, 8, 9}));
  CHECK((hit->ray == 5 && hit->lease == 6 && hit->t == 1.5f && hit->triangle == 7 && hit->voxel == 8 &&
         hit->local == 9));
  const auto alive = DecodeWorkerStatus(Encode(WorkerStatus{1, 2, 3, 4, 5, 6, 7, 8}));
  CHECK((alive->cache_bytes == 1 && alive->voxels_loaded == 2 && alive->voxel_bytes_loaded == 3 &&
         alive->voxel_bytes_received == 4 && alive->evictions == 5 && alive->rays == 6 &&
         alive->rays_suspended == 7 && alive->peak_rss_bytes == 8));
  WorkerStatus wants;
  wants.tiles_wanted = 9;
  CHECK(DecodeWorkerStatus(Encode(wants))->tiles_wanted == 9);
  CHECK(DecodeBlockRequest(Encode(BlockRequest{123}))->block == 123);
}

TEST_CASE("Selections, lists of parts and sections are decoded to the same fields") {
  PartSelection selection{.hidden = {5, 1ull << 63},
                          .voxels = {PartSelection::Shown::kAll, PartSelection::Shown::kNone},
                          .closed = {7, 8},
                          .inverted = {1, 0},
                          .colors = {{0.5f, 0, 1}},
                          .color_of = {0, 1, 0}};
  selection.id = IdOf(selection);
  const auto back = DecodeSelection(Encode(selection));
  REQUIRE(back.has_value());
  CHECK((back->id == selection.id && IdOf(*back) == back->id && back->voxels == selection.voxels));
  PartSelection bad = selection;
  bad.id = 0;
  CHECK_FALSE(DecodeSelection(Encode(bad)).has_value());
  bad = selection;
  bad.voxels = {static_cast<PartSelection::Shown>(3)};
  CHECK_FALSE(DecodeSelection(Encode(bad)).has_value());

  RenderJob job = MakeJob();
  auto lists = std::make_shared<PartLists>();
  lists->hide = {"a/b", "c*"};
  lists->only = {"a"};
  lists->colors = {{{"a/d"}, glm::vec3(1, 0, 0)}, {{"e", "f"}, std::nullopt}};
  job.view.parts.lists = lists;
  job.view.section = {true, {1, 2, 3}, {4, 6, 8}, {{{1, 1, 1}, {0, 0, 1}}}, false};
  const auto read = DecodeJobRequest(Encode(JobRequest{job, 0}));
  REQUIRE(read.has_value());
  REQUIRE(read->job.view.parts.lists);
  CHECK(*read->job.view.parts.lists == *lists);
  CHECK(read->job.view.section == job.view.section);
  CHECK(Encode(JobRequest{read->job, 0}) == Encode(JobRequest{job, 0}));
  lists->only->clear();
  CHECK_FALSE(DecodeJobRequest(Encode(JobRequest{job, 0})).has_value());
  job = MakeJob();
  job.view.section.planes.assign(kMaxSectionPlanes + 1, {{0, 0, 0}, {0, 0, 1}});
  CHECK_FALSE(DecodeJobRequest(Encode(JobRequest{job, 0})).has_value());

  View view = FrameView(MakeJob());
  view.parts.selection = std::make_shared<const PartSelection>(selection);
  CHECK(DecodeFrameSetup(Encode(FrameSetup{1, view, 0}))->selection == selection.id);
  const auto ray = DecodeRayOrder(
      Encode(RayOrder{.query = {{1, 2, 3}, {0, 1, 0}, 7}, .parts = view.parts, .section = view.section}));
  CHECK((ray->selection == selection.id && ray->section == view.section));
  RayOrder longest;
  longest.section = {true, {1, 2, 3}, {4, 6, 8}, {kMaxSectionPlanes, {{1, 1, 1}, {0, 0, 1}}}, true};
  longest.parts = view.parts;
  CHECK(Encode(longest).size() <= 1024);  // the limit of a Ray's table
}

TEST_CASE("An atmosphere goes to workers with its table; a client's table is not taken", "[protocol]") {
  View view;
  view.mode = RenderMode::kPath;
  view.lights = {Light{}};
  view.sky.haze = 3;
  const auto sent = [&](const std::function<void(AtmosphereTable&)>& change) {
    AtmosphereTable table;
    for (uint32_t i = 0; i < AtmosphereTable::kRows * AtmosphereTable::kColumns; ++i)
      table.radiance.emplace_back(i, i + 0.25f, i + 0.5f);
    table.sun = {0.9f, 0.8f, 0.7f};
    change(table);
    view.sky.atmosphere = std::make_shared<const AtmosphereTable>(std::move(table));
    return DecodeFrameSetup(Encode(FrameSetup{1, view, 0}));
  };
  const auto good = sent([](AtmosphereTable&) {});
  REQUIRE(good.has_value());
  REQUIRE(good->view.sky.atmosphere);
  CHECK(good->view.sky.haze == 3);
  CHECK(good->view.sky.atmosphere->radiance == view.sky.atmosphere->radiance);
  CHECK(good->view.sky.atmosphere->sun == view.sky.atmosphere->sun);
  CHECK_FALSE(sent([](AtmosphereTable& t) { t.radiance.pop_back(); }).has_value());
  CHECK_FALSE(sent([](AtmosphereTable& t) { t.radiance[7].y = -1; }).has_value());
  CHECK_FALSE(sent([](AtmosphereTable& t) { t.radiance[7].z = NAN; }).has_value());
  CHECK_FALSE(sent([](AtmosphereTable& t) { t.sun.x = INFINITY; }).has_value());
  REQUIRE(sent([](AtmosphereTable&) {}).has_value());
  RenderJob job = MakeJob();
  job.view.lights = view.lights;
  job.view.sky = view.sky;
  const auto asked = DecodeJobRequest(Encode(JobRequest{job, 0}));
  INFO((asked ? "" : asked.error().message));
  REQUIRE(asked.has_value());
  CHECK(asked->job.view.sky.haze == 3);
  CHECK_FALSE(asked->job.view.sky.atmosphere);
  view.sky.atmosphere = nullptr;
  CHECK_FALSE(DecodeFrameSetup(Encode(FrameSetup{1, view, 0})).has_value());
  view.sky.haze = 0.5f;
  CHECK_FALSE(DecodeFrameSetup(Encode(FrameSetup{1, view, 0})).has_value());
}

TEST_CASE("Invalid values are refused") {
  TileOrder order{1, 2, 3, {{4, 5, 6, 7}}};
  order.area.form = static_cast<PixelForm>(3);
  CHECK_FALSE(DecodeTileOrder(Encode(order)).has_value());
  CHECK_FALSE(DecodeFramesEnd(Encode(FramesEnd{std::vector<uint64_t>(kMaxFramesEnded + 1)})).has_value());
  CHECK_FALSE(DecodeLeave(Encode(Leave{{7, 8}, {9}})).has_value());
  const std::vector<uint64_t> many(kMaxGivenBack + 1);
  CHECK_FALSE(DecodeLeave(Encode(Leave{many, many})).has_value());
  const double none = std::numeric_limits<double>::quiet_NaN();
  for (const RayQuery& ray : {RayQuery{{none, 0, 0}, {0, 0, 1}, 1}, RayQuery{{0, 0, 0}, {0, 0, 0}, 1},
                              RayQuery{{0, 0, 0}, {0, 0, 1}, 0}, RayQuery{{0, 0, 0}, {0, 0, 1}, none}})
    CHECK_FALSE(DecodeRayOrder(Encode(RayOrder{1, 1, ray})).has_value());
  for (const float t : {-1.0f, std::numeric_limits<float>::quiet_NaN()})
    CHECK_FALSE(DecodeRayDone(Encode(RayDone{1, 1, t, 7, 8, 9})).has_value());
  RenderJob job = MakeJob();
  job.view.spp = 0;
  CHECK_FALSE(DecodeJobRequest(Encode(JobRequest{job, 0})).has_value());
  job = MakeJob();
  job.cameras[0].eye = job.cameras[0].at;
  CHECK_FALSE(DecodeJobRequest(Encode(JobRequest{job, 0})).has_value());
  View view = FrameView(MakeJob());
  view.camera.eye = view.camera.at;
  CHECK_FALSE(DecodeFrameSetup(Encode(FrameSetup{1, view, 0})).has_value());
  view = FrameView(MakeJob());
  view.crop.width = 640;
  CHECK_FALSE(DecodeFrameSetup(Encode(FrameSetup{1, view, 0})).has_value());
}

TEST_CASE("A job is the same however many programs it has passed through") {
  // A master that goes on from its spool has read it once more than one that was never stopped.
  std::mt19937 random(5);
  std::uniform_real_distribution<float> any(-1, 1);
  for (int i = 0; i < 2000; ++i) {
    RenderJob job = MakeJob();
    job.view.lights = {{LightKind::kSun, {any(random), any(random), any(random)}, {1, 1, 1}}};
    const Bytes once = Encode(JobRequest{DecodeJobRequest(Encode(JobRequest{job, 0}))->job, 0});
    CHECK(Encode(JobRequest{DecodeJobRequest(once)->job, 0}) == once);
  }
}

TEST_CASE("Mutated messages are refused or read, never worse") {
  std::mt19937 random(11);
  const Bytes good[] = {
      Encode(JobRequest{MakeJob(), 0}),
      Encode(Hello{Role::kWorker, "w", 2}),
      Encode(TileOrder{1, 2, 3, {{4, 5, 6, 7}}}),
      Encode(FrameDone{6, "{}"}),
      Encode(RayOrder{1, 2, {}}),
      Encode(PartSelection{.id = 1, .hidden = {5}, .voxels = {{}, {}}, .color_of = {1, 2}})};
  for (int i = 0; i < 40000; ++i) {
    Bytes bad = good[static_cast<size_t>(i) % std::size(good)];
    for (int k = 0; k < 1 + i % 4; ++k) bad[random() % bad.size()] = static_cast<std::byte>(random());
    if (i % 7 == 0) bad.resize(random() % (bad.size() + 1));
    (void)DecodeJobRequest(bad);
    (void)DecodeFrameSetup(bad);
    (void)DecodeHello(bad);
    (void)DecodeTileOrder(bad);
    (void)DecodeFrameDone(bad);
    (void)DecodeRayOrder(bad);
    (void)DecodeSelection(bad);
    (void)UnpackSections(bad);
  }
}

/// With its own checksum made right again.
Bytes Sealed(Bytes header) {
  const uint64_t checksum = Checksum(std::span(header).first(kFrameHeaderBytes - 8));
  std::memcpy(header.data() + kFrameHeaderBytes - 8, &checksum, 8);
  return header;
}

TEST_CASE("Frame headers are checked before anything is allocated") {
  const Message m{MessageType::kBlock, 42, Bytes(0), Bytes(1000)};
  const auto header = DecodeFrameHeader(EncodeFrameHeader(m));
  REQUIRE(header.has_value());
  CHECK((header->type == MessageType::kBlock && header->request == 42 && header->table_bytes == 0 &&
         header->raw_bytes == 1000));
  for (auto type :
       {MessageType::kHello, MessageType::kTile, MessageType::kTileDone, MessageType::kRenderJob}) {
    Bytes bytes = EncodeFrameHeader({type, 0, {}, {}});
    for (size_t i = 16; i < 24; ++i) bytes[i] = std::byte{0xFF};
    const auto oversized = DecodeFrameHeader(Sealed(bytes));
    REQUIRE_FALSE(oversized.has_value());
    CHECK(oversized.error().message.find("size limit") != std::string::npos);
  }
  Bytes unknown = EncodeFrameHeader(m);
  unknown[4] = std::byte{200};
  const auto refused = DecodeFrameHeader(Sealed(unknown));
  REQUIRE_FALSE(refused.has_value());
  CHECK(refused.error().message.find("unknown type") != std::string::npos);
  unknown[0] = std::byte{0};
  CHECK_FALSE(DecodeFrameHeader(Sealed(unknown)).has_value());
  Bytes reserved = EncodeFrameHeader(m);
  reserved[6] = std::byte{1};
  CHECK_FALSE(DecodeFrameHeader(Sealed(reserved)).has_value());
}

TEST_CASE("A changed byte of a message is noticed, wherever it is") {
  Message m{MessageType::kTileDone, 7, Encode(TileDone{1, 2, 3}), Bytes(300)};
  const Bytes good = EncodeFrameHeader(m);
  const auto header = DecodeFrameHeader(good);
  REQUIRE(header.has_value());
  CHECK(CheckContent(*header, m).has_value());
  for (size_t i = 0; i < good.size(); ++i)
    for (int bit = 0; bit < 8; ++bit) {
      Bytes bad = good;
      bad[i] ^= static_cast<std::byte>(1 << bit);
      CHECK_FALSE(DecodeFrameHeader(bad).has_value());
    }
  for (Bytes* part : {&m.table, &m.raw})
    for (std::byte& byte : *part) {
      byte ^= std::byte{16};
      CHECK_FALSE(CheckContent(*header, m).has_value());
      byte ^= std::byte{16};
    }
  // Nor may a byte move from one part to the other.
  Message moved = m;
  moved.raw.insert(moved.raw.begin(), moved.table.back());
  moved.table.pop_back();
  CHECK_FALSE(DecodeFrameHeader(EncodeFrameHeader(moved))->table_bytes == header->table_bytes);
}

TEST_CASE("Preambles of another version name both") {
  CHECK(CheckPreamble(EncodePreamble()).has_value());
  const Status other = CheckPreamble(EncodePreamble(kProtocolVersion + 1, "3.2.1"));
  REQUIRE_FALSE(other.has_value());
  CHECK(other.error().message.find(fmt::format("3.2.1 with protocol {}", kProtocolVersion + 1)) !=
        std::string::npos);
  CHECK(other.error().message.find(fmt::format("protocol {},", kProtocolVersion)) != std::string::npos);
  CHECK_FALSE(CheckPreamble(Bytes(32)).has_value());
  CHECK_FALSE(CheckPreamble(Bytes(3)).has_value());
}

}  // namespace quarry
