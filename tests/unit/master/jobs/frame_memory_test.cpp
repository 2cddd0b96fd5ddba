#include "master/jobs/frame_memory.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "master/jobs/spool.h"
#include "master/pictures/image_output.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

RenderJob Job(uint32_t side, const std::string& format = "png", uint32_t aovs = 0, size_t frames = 1) {
  RenderJob job;
  job.view.width = job.view.height = side;
  job.format.name = format;
  job.view.aov_mask = aovs;
  job.cameras.assign(frames, CameraSpec{});
  REQUIRE(NormalizeJob(job).has_value());
  return job;
}

uint64_t BytesOf(const RenderJob& job) { return FrameBytes(job.view, job.format); }

}  // namespace

TEST_CASE("A frame's memory is computed before it is allocated, without overflow") {
  const uint64_t pixels = uint64_t{1} << 32;
  CHECK(BytesOf(Job(65536)) > pixels * (16 + 2 * 3));
  CHECK(BytesOf(Job(65536)) < pixels * 24);
  CHECK(BytesOf(Job(65536, "exr", 127)) > pixels * 3 * 14 * 4);
  CHECK(BytesOf(Job(64)) < 2 << 20);
}

TEST_CASE("The README states the largest picture of 1G") {
  const FrameMemory memory(uint64_t{1} << 30);
  const auto fits = [&](uint32_t side, uint32_t spp) {
    RenderJob job = Job(side);
    job.view.spp = spp;
    return memory.CheckJob(job, 0).has_value();
  };
  CHECK(fits(5800, 4));
  CHECK_FALSE(fits(5900, 4));
  CHECK(fits(6300, 1));
  CHECK_FALSE(fits(6400, 1));
}

TEST_CASE("No encoded image is larger than computed") {
  for (const auto& job : {Job(200), Job(200, "exr"), Job(200, "exr", 127), Job(1), Job(1, "exr", 127)}) {
    std::vector<uint32_t> pixels(size_t{job.view.width} * job.view.height * WordsPerPixel(job.view.aov_mask));
    uint32_t noise = 1;
    for (uint32_t& word : pixels) word = 0x3e000000 + ((noise = noise * 1664525 + 1013904223) >> 7);
    const auto image = EncodeImage(job.view, job.format, {}, job.format.exposure.value_or(0), pixels);
    REQUIRE(image.has_value());
    CHECK(image->size() <= EncodedBytes(job.view, job.format));
  }
}

TEST_CASE("A job that needs too much memory is refused with figures") {
  const FrameMemory memory(64 << 20);
  CHECK(memory.CheckJob(Job(1000), 0).has_value());
  const Status large = memory.CheckJob(Job(65536), 0);
  REQUIRE_FALSE(large.has_value());
  CHECK_THAT(large.error().message, Catch::Contains("65536x65536 takes 92.") &&
                                        Catch::Contains("it has 56.0 MiB for pictures") &&
                                        Catch::Contains("--frame-memory"));
  const RenderJob longest = Job(16, "png", 0, kMaxFrames);
  CHECK_FALSE(memory.CheckJob(longest, 0).has_value());
  CHECK(FrameMemory(256 << 20).CheckJob(longest, 0).has_value());
  const Status many = FrameMemory(256 << 20).CheckJob(longest, 30 << 20);
  REQUIRE_FALSE(many.has_value());
  CHECK_THAT(many.error().message, Catch::Contains("65536 frames") && Catch::Contains("30.0 MiB of its"));
}

TEST_CASE("A frame's memory is returned with its last reference") {
  FrameMemory memory(1000);
  auto first = memory.Take(600), second = memory.Take(500);
  CHECK(memory.used() == 1100);
  auto copy = first;
  first.reset();
  CHECK(memory.used() == 1100);
  copy.reset();
  CHECK(memory.used() == 500);
  second.reset();
  CHECK(memory.used() == 0);
}

TEST_CASE("A job that ended three masters is set aside, unless it has finished a frame") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("spool");
  const RenderJob job = Job(32, "png", 0, 3);
  const std::string id = JobId(SceneId{}, job);
  std::vector<std::string> log;
  const auto found = [&](const Spool& spool) {
    return spool.Jobs([&](const std::string& line) { log.push_back(line); });
  };
  {
    const auto spool = Spool::Open(path, SceneId{});
    REQUIRE(spool->Begin(id, job).has_value());  // the first try
    spool->NoteTry(id);
    REQUIRE(found(*spool).size() == 1);
    CHECK(found(*spool)[0].tries == 2);
    REQUIRE(spool->WriteFrame(id, job, 0, Bytes(3)).has_value());
    CHECK(found(*spool)[0].tries == 0);
  }
  for (uint32_t tries = 0; tries < Spool::kMostTries; ++tries) {
    const auto spool = Spool::Open(path, SceneId{});  // another master
    REQUIRE(found(*spool).size() == 1);
    CHECK(spool->CheckNotSetAside(id).has_value());
    spool->NoteTry(id);
  }
  CHECK(log.empty());
  const auto spool = Spool::Open(path, SceneId{});
  CHECK(found(*spool).empty());
  REQUIRE(log.size() == 1);
  CHECK_THAT(log[0],
             Catch::Contains("has ended 3 masters") && Catch::Contains(path + "/" + id + ".set-aside"));
  CHECK(std::filesystem::exists(path + "/" + id + ".set-aside/job"));
  CHECK(found(*spool).empty());
  const Status asked = spool->CheckNotSetAside(id);
  REQUIRE_FALSE(asked.has_value());
  CHECK_THAT(asked.error().message, Catch::Contains(".set-aside; remove that"));
  std::filesystem::remove_all(path + "/" + id + ".set-aside");
  CHECK(spool->CheckNotSetAside(id).has_value());
}

}  // namespace quarry
