#include "master/jobs/jobs.h"

#include <algorithm>
#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/cluster/still_connection.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using namespace std::chrono_literals;

constexpr uint64_t kMemory = 256 << 20;

/// A client of which the test says how much it has read.
struct Client final : test::StillConnection {
  explicit Client(std::string its_name = "client:1") : StillConnection(std::move(its_name)) {}
  void Send(Message message) override { got.push_back(std::move(message)); }
  uint64_t queued_bytes() const override { return queued; }

  /// The numbers of the frames that have come, in their order.
  std::vector<uint32_t> Frames() const {
    std::vector<uint32_t> frames;
    for (const Message& m : got)
      if (m.type == MessageType::kFrameDone) frames.push_back(DecodeFrameDone(m.table)->frame);
    return frames;
  }
  std::vector<std::string> Failures() const {
    std::vector<std::string> sentences;
    for (const Message& m : got)
      if (m.type == MessageType::kFailure) sentences.push_back(DecodeFailure(m.table)->message);
    return sentences;
  }

  std::string name;
  std::vector<Message> got;
  uint64_t queued = 0;
};

RenderJob Walk(size_t frames, double eye = 1, uint32_t side = 40) {
  RenderJob job;
  job.view.width = job.view.height = side;
  job.first_frame = 10;
  for (size_t f = 0; f < frames; ++f) {
    CameraSpec camera;
    camera.eye = {eye + static_cast<double>(f), -5, 0};
    job.cameras.push_back(camera);
  }
  REQUIRE(NormalizeJob(job).has_value());
  return job;
}

using Numbers = std::vector<uint32_t>;

/// Jobs, of which the test renders the frames.
struct Office {
  explicit Office(std::optional<Spool> spool = {}, uint64_t memory = kMemory)
      : jobs(io, SceneFacts{}, std::move(spool), memory,
             {[this] { ++work; }, [this](const Job& job) { over.push_back(job.id); },
              [this](const std::string& line) { log.push_back(line); },
              [this](const Job&, std::function<void(double)> done) {
                ++metered;
                if (meters_at_once)
                  done(1.5);
                else
                  metered_later = std::move(done);
              }}) {}

  Status Ask(const std::shared_ptr<Client>& client, const RenderJob& job, uint32_t have = 0) {
    return jobs.Ask(client, {job, have});
  }
  /// Begins all frames that may begin.
  std::vector<JobFrame> BeginAll() {
    std::vector<JobFrame> begun;
    while (auto frame = jobs.Begin()) begun.push_back(std::move(*frame));
    return begun;
  }
  /// Renders a frame; does not wait for its image.
  void Render(JobFrame frame) {
    std::vector<uint32_t> pixels(kColorWords * size_t{frame.view.width} * frame.view.height);
    jobs.Finish(std::move(frame), std::move(pixels), R"({"by": "test"})");
  }
  /// Runs posted work until `condition` holds.
  template <class Condition>
  void RunUntil(Condition condition) {
    const auto end = std::chrono::steady_clock::now() + 60s;
    while (!condition() && std::chrono::steady_clock::now() < end) io.run_one_for(10ms);
    REQUIRE(condition());
  }
  /// Renders all frames that begin, until none is left.
  void RenderAll() {
    for (auto begun = BeginAll(); !begun.empty(); begun = BeginAll())
      for (JobFrame& frame : begun) {
        const auto job = frame.job;
        const size_t index = frame.index;
        Render(std::move(frame));
        RunUntil([&] { return job->states[index] != Job::FrameState::kActive; });
      }
  }
  bool Logged(const std::string& part) const {
    return std::ranges::any_of(log, [&](const auto& line) { return line.find(part) != std::string::npos; });
  }

  boost::asio::io_context io;
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> stays{io.get_executor()};
  int work = 0;
  int metered = 0;
  bool meters_at_once = true;
  std::function<void(double)> metered_later;
  std::vector<std::string> over, log;
  Jobs jobs;
};

Spool OpenSpool(const std::string& folder) {
  auto spool = Spool::Open(folder, SceneId{});
  REQUIRE(spool.has_value());
  return std::move(*spool);
}

}  // namespace

TEST_CASE("A job's exposure is metered once, unless it is given or the file format needs none", "[jobs]") {
  for (const std::string format : {"auto", "given", "exr"}) {
    Office office;
    RenderJob walk = Walk(3);
    if (format == "given") walk.format.exposure = -2;
    if (format == "exr") walk.format.name = "exr";
    const auto client = std::make_shared<Client>();
    REQUIRE(office.Ask(client, walk).has_value());
    office.RenderAll();
    office.RunUntil([&] { return client->got.size() == 3; });
    CHECK(office.metered == (format == "auto" ? 1 : 0));
    for (const Message& message : client->got) {
      const auto statistics = nlohmann::json::parse(DecodeFrameDone(message.table)->statistics);
      CHECK(statistics["exposure_ev"] == (format == "auto" ? 1.5 : format == "given" ? -2 : 0));
    }
  }
}

TEST_CASE("Frames wait for their job's exposure, and go with their job", "[jobs]") {
  Office office;
  office.meters_at_once = false;
  const auto a = std::make_shared<Client>(), b = std::make_shared<Client>("client:2");
  REQUIRE(office.Ask(a, Walk(2)).has_value());
  RenderJob linear = Walk(1, 100);
  linear.format.name = "exr";
  REQUIRE(office.Ask(b, linear).has_value());
  auto begun = office.BeginAll();
  REQUIRE(begun.size() == 3);
  const auto job = begun[0].job, other = begun[2].job;
  for (JobFrame& frame : begun) office.Render(std::move(frame));
  office.RunUntil([&] { return b->Frames() == Numbers{10}; });  // an EXR has no exposure
  CHECK(a->Frames().empty());
  CHECK(job->states[0] == Job::FrameState::kActive);
  office.metered_later(2.5);
  office.RunUntil([&] { return a->Frames() == Numbers{10, 11}; });
  CHECK(nlohmann::json::parse(DecodeFrameDone(a->got[0].table)->statistics)["exposure_ev"] == 2.5);
  CHECK(office.metered == 1);

  // A job that ends takes its frames along, and others begin in their place.
  const auto c = std::make_shared<Client>("client:3");
  REQUIRE(office.Ask(c, Walk(4, 200)).has_value());
  auto lost = office.BeginAll();
  REQUIRE(lost.size() == 4);
  const auto failed = lost[0].job;
  for (JobFrame& frame : lost) office.Render(std::move(frame));
  REQUIRE(office.Ask(a, Walk(1, 300)).has_value());
  CHECK(office.BeginAll().empty());  // too many are on their way to the disk
  office.jobs.Fail(failed, "a reason");
  CHECK(office.BeginAll().size() == 1);
}

TEST_CASE("Frames are begun in the order of jobs and cameras, each with its own camera", "[jobs]") {
  Office office;
  const auto a = std::make_shared<Client>(), b = std::make_shared<Client>("client:2");
  REQUIRE(office.Ask(a, Walk(2)).has_value());
  REQUIRE(office.Ask(b, Walk(1, 100)).has_value());
  CHECK(office.work == 2);
  const auto upcoming = office.jobs.Upcoming(5);
  REQUIRE(upcoming.size() == 3);
  CHECK(office.jobs.Upcoming(2).size() == 2);
  const auto begun = office.BeginAll();
  REQUIRE(begun.size() == 3);
  const double eyes[] = {1, 2, 100};
  const uint32_t numbers[] = {10, 11, 10};
  for (size_t i = 0; i < 3; ++i) {
    CHECK(begun[i].view.camera.eye.x == eyes[i]);
    CHECK(begun[i].number() == numbers[i]);
    CHECK(upcoming[i].view.camera.eye.x == eyes[i]);
    CHECK(begun[i].memory != nullptr);
  }
  CHECK(office.jobs.Upcoming(5).empty());
}

TEST_CASE("Frames are sent to a client in their order, whichever is rendered first", "[jobs]") {
  Office office;
  const auto client = std::make_shared<Client>();
  REQUIRE(office.Ask(client, Walk(4)).has_value());
  auto begun = office.BeginAll();
  REQUIRE(begun.size() == 4);
  const auto job = begun[0].job;
  const auto render = [&](size_t index) {
    office.Render(begun[index]);
    office.RunUntil([&] { return job->states[index] == Job::FrameState::kFinished; });
  };
  render(2);
  render(1);
  CHECK(client->Frames().empty());
  render(0);
  CHECK(client->Frames() == Numbers{10, 11, 12});
  CHECK(office.over.empty());
  render(3);
  CHECK(client->Frames() == Numbers{10, 11, 12, 13});
  CHECK(office.over == std::vector<std::string>{job->id});
  CHECK(office.jobs.all().empty());
  CHECK(job->over);
  for (const Message& message : client->got) {
    CHECK(message.raw.size() > 8);  // a PNG
    CHECK(message.raw[1] == std::byte{'P'});
    CHECK(nlohmann::json::parse(DecodeFrameDone(message.table)->statistics)["by"] == "test");
  }
}

TEST_CASE("A job requested twice is rendered once, for both clients", "[jobs]") {
  Office office;
  const auto first = std::make_shared<Client>(), second = std::make_shared<Client>("client:2");
  REQUIRE(office.Ask(first, Walk(3)).has_value());
  auto frame = office.jobs.Begin();
  REQUIRE(frame);
  office.Render(std::move(*frame));
  office.RunUntil([&] { return first->Frames().size() == 1; });
  REQUIRE(office.Ask(second, Walk(3), 2).has_value());  // it has two
  CHECK(office.jobs.all().size() == 1);
  office.RenderAll();
  CHECK(first->Frames() == Numbers{10, 11, 12});
  CHECK(second->Frames() == Numbers{12});
  CHECK(office.over.size() == 1);
}

TEST_CASE("Frames that a client has are not rendered until another client requests them", "[jobs]") {
  Office office;
  const auto first = std::make_shared<Client>(), second = std::make_shared<Client>("client:2");
  REQUIRE(office.Ask(first, Walk(3), 2).has_value());
  auto begun = office.BeginAll();
  REQUIRE(begun.size() == 1);
  CHECK(begun[0].index == 2);
  REQUIRE(office.Ask(second, Walk(3)).has_value());
  office.Render(std::move(begun[0]));
  office.RenderAll();
  CHECK(first->Frames() == Numbers{12});
  CHECK(second->Frames() == Numbers{10, 11, 12});
  CHECK(office.over.size() == 1);
}

TEST_CASE("A job without clients is dropped after a while, unless it is requested again", "[jobs]") {
  Office office;
  auto client = std::make_shared<Client>();
  REQUIRE(office.Ask(client, Walk(3)).has_value());
  auto begun = office.BeginAll();
  const auto job = begun[0].job;
  CHECK(office.jobs.ForgetClient(client, 100));
  CHECK_FALSE(office.jobs.ForgetClient(client, 100));  // it is gone already
  office.jobs.DropAbandoned(119);
  CHECK(office.jobs.all().size() == 1);
  // Its frames go on meanwhile, and a client that comes back finds them.
  office.Render(begun[0]);
  office.RunUntil([&] { return job->states[0] == Job::FrameState::kFinished; });
  client = std::make_shared<Client>("client:2");
  REQUIRE(office.Ask(client, Walk(3)).has_value());
  office.jobs.DropAbandoned(200);
  CHECK(office.jobs.all().size() == 1);
  CHECK(office.jobs.ForgetClient(client, 300));
  office.jobs.DropAbandoned(319);
  CHECK_FALSE(job->over);
  office.jobs.DropAbandoned(321);
  CHECK(job->over);
  CHECK(office.over == std::vector<std::string>{job->id});
  CHECK(office.jobs.all().empty());
  CHECK(office.Logged("dropped"));
  CHECK_FALSE(office.jobs.Begin());
}

TEST_CASE("A job that fails tells its clients, and late frames of it are dropped", "[jobs]") {
  Office office;
  const auto first = std::make_shared<Client>(), second = std::make_shared<Client>("client:2"),
             other = std::make_shared<Client>("client:3");
  REQUIRE(office.Ask(first, Walk(2)).has_value());
  REQUIRE(office.Ask(second, Walk(2)).has_value());
  REQUIRE(office.Ask(other, Walk(1, 100)).has_value());
  auto begun = office.BeginAll();
  REQUIRE(begun.size() == 3);
  const std::string id = begun[0].job->id;
  office.jobs.Fail(begun[0].job, "no block comes");
  for (const auto& client : {first, second})
    CHECK(client->Failures() == std::vector<std::string>{"no block comes"});
  CHECK(other->Failures().empty());
  CHECK(office.over == std::vector<std::string>{id});
  const int work = office.work;
  office.Render(begun[0]);
  office.RunUntil([&] { return office.work > work; });
  CHECK(first->Frames().empty());
  office.Render(begun[2]);
  office.RunUntil([&] { return !other->Frames().empty(); });
  CHECK(office.jobs.all().empty());
}

TEST_CASE("A client that reads slowly gets frames as it reads, and none is lost", "[jobs]") {
  Office office;
  const auto slow = std::make_shared<Client>(), quick = std::make_shared<Client>("client:2");
  REQUIRE(office.Ask(slow, Walk(3)).has_value());
  REQUIRE(office.Ask(quick, Walk(1, 100)).has_value());
  slow->queued = 64 << 20;
  office.RenderAll();
  CHECK(slow->Frames().empty());
  CHECK(quick->Frames().empty());  // both share the bytes that may be on their way
  slow->queued = 0;
  office.jobs.Deliver();
  CHECK(slow->Frames() == Numbers{10, 11, 12});
  CHECK(quick->Frames() == Numbers{10});
  CHECK(office.over.size() == 2);
}

TEST_CASE("Frames are begun only as fast as they are encoded, and within their memory", "[jobs]") {
  const RenderJob walk = Walk(12, 1, 400);
  {
    Office office;
    REQUIRE(office.Ask(std::make_shared<Client>(), walk).has_value());
    for (int frames = 0; auto frame = office.jobs.Begin(); ++frames) {
      REQUIRE(frames < 12);
      office.Render(std::move(*frame));
    }
    const auto active = std::ranges::count(office.jobs.all()[0]->states, Job::FrameState::kActive);
    CHECK(active == 4);
    office.RunUntil([&] {
      office.RenderAll();
      return office.over.size() == 1;
    });
  }
  const uint64_t each = FrameBytes(walk.view, walk.format);
  Office office({}, 8 * (3 * each + each / 2) / 7);
  const auto client = std::make_shared<Client>();
  REQUIRE(office.Ask(client, walk).has_value());
  {
    const auto begun = office.BeginAll();
    CHECK(begun.size() == 3);
  }
  CHECK(office.jobs.Begin());  // into the memory that those have given back
}

TEST_CASE("A job that needs more memory than there is is refused, and nothing of it is kept", "[jobs]") {
  const test::TemporaryFolder folder;
  Office office(OpenSpool(folder.file("spool")), 4 << 20);
  const auto client = std::make_shared<Client>();
  const Status status = office.Ask(client, Walk(1, 1, 4096));
  REQUIRE_FALSE(status.has_value());
  CHECK_THAT(status.error().message, Catch::Contains("4096x4096"));
  CHECK(office.jobs.all().empty());
  CHECK_FALSE(office.jobs.Begin());
  CHECK(office.Ask(client, Walk(1)).has_value());
}

TEST_CASE("Another master continues a spool's jobs and renders their missing frames", "[jobs]") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("spool");
  {
    Office office(OpenSpool(path));
    const auto client = std::make_shared<Client>();
    REQUIRE(office.Ask(client, Walk(3)).has_value());
    auto begun = office.BeginAll();
    office.Render(begun[1]);
    office.RunUntil([&] { return begun[0].job->states[1] == Job::FrameState::kFinished; });
    CHECK(client->Frames().empty());
    office.jobs.ForgetClient(client, 0);
    office.jobs.DropAbandoned(1000);
    CHECK(office.jobs.all().size() == 1);  // a spool keeps it
  }
  {
    Office office(OpenSpool(path));
    office.jobs.TakeUp();
    REQUIRE(office.jobs.all().size() == 1);
    CHECK(office.Logged("1 of 3 frames are done"));
    const auto client = std::make_shared<Client>();
    REQUIRE(office.Ask(client, Walk(3)).has_value());
    CHECK(office.jobs.all().size() == 1);
    Numbers begun;
    office.RunUntil([&] {
      while (auto frame = office.jobs.Begin()) {
        begun.push_back(static_cast<uint32_t>(frame->index));
        office.Render(std::move(*frame));
      }
      return office.over.size() == 1;
    });
    CHECK(begun == Numbers{0, 2});
    CHECK(client->Frames() == Numbers{10, 11, 12});
    CHECK_THAT(DecodeFrameDone(client->got[1].table)->statistics, Catch::Contains("from_spool"));
    CHECK_THAT(DecodeFrameDone(client->got[2].table)->statistics, Catch::Contains("test"));
  }
  Office office(OpenSpool(path));
  office.jobs.TakeUp();
  CHECK(office.jobs.all().empty());
}

TEST_CASE("A frame that has been damaged in the spool is rendered again", "[jobs]") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("spool");
  std::string frame;
  {
    Office office(OpenSpool(path));
    const auto client = std::make_shared<Client>();
    REQUIRE(office.Ask(client, Walk(2)).has_value());
    auto begun = office.BeginAll();
    frame = path + "/" + begun[1].job->id + "/0011.png";
    office.Render(begun[1]);
    office.RunUntil([&] { return begun[1].job->states[1] == Job::FrameState::kFinished; });
  }
  {
    std::fstream file(frame, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(40);
    file.put('\x55');
  }
  Office office(OpenSpool(path));
  office.jobs.TakeUp();
  CHECK(office.Logged("1 of 2 frames are done"));
  const auto client = std::make_shared<Client>();
  REQUIRE(office.Ask(client, Walk(2)).has_value());
  office.RunUntil([&] {
    office.RenderAll();
    return office.over.size() == 1;
  });
  CHECK(client->Frames() == Numbers{10, 11});
  CHECK(office.Logged("0011.png: is damaged (checksum); the frame is rendered again"));
  for (const Message& message : client->got)
    CHECK_THAT(DecodeFrameDone(message.table)->statistics, Catch::Contains("test"));
}

TEST_CASE("A frame of a job that may have ended a master is rendered alone", "[jobs]") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("spool");
  const auto client = std::make_shared<Client>();
  {
    // The master ends while it renders the job's first frames.
    Office office(OpenSpool(path));
    REQUIRE(office.Ask(client, Walk(2)).has_value());
    CHECK(office.BeginAll().size() == 2);
    const std::string job = office.jobs.all()[0]->id;
    office.RunUntil([&] { return std::filesystem::exists(path + "/" + job + "/job"); });
  }
  Office office(OpenSpool(path));
  office.jobs.TakeUp();
  REQUIRE(office.jobs.all().size() == 1);
  const auto suspect = office.jobs.all()[0];
  CHECK(suspect->suspect);
  REQUIRE(office.Ask(client, Walk(2, 100)).has_value());
  suspect->states[1] = Job::FrameState::kFinished;  // it has one frame left
  auto alone = office.jobs.Begin();
  REQUIRE(alone);
  CHECK(alone->job == suspect);
  CHECK_FALSE(office.jobs.Begin());  // neither of another job
  office.Render(std::move(*alone));
  office.RunUntil([&] { return suspect->states[0] == Job::FrameState::kFinished; });
  CHECK_FALSE(suspect->suspect);
  CHECK(office.BeginAll().size() == 2);
}

TEST_CASE("A job with a noise is tried, then metered, and begins with what its meter saw", "[jobs]") {
  const auto noisy = [] {
    RenderJob job = Walk(2);
    job.view.noise = 0.1;
    job.view.spp = 64;
    job.format.exposure = -2;  // of its PNGs alone
    REQUIRE(NormalizeJob(job).has_value());
    return job;
  };
  for (const bool suspect : {false, true}) {
    Office office;
    office.meters_at_once = false;
    const auto client = std::make_shared<Client>();
    REQUIRE(office.Ask(client, noisy()).has_value());
    RenderJob other = Walk(1, 100);
    other.format.name = "exr";  // it needs no meter
    REQUIRE(office.Ask(client, other).has_value());
    const auto job = office.jobs.all()[0];
    job->tried = false;
    job->suspect = suspect;
    // Others begin meanwhile, unless the job may have ended a master: its meter may do so again.
    REQUIRE(office.metered == 0);
    auto others = office.BeginAll();
    CHECK(others.size() == (suspect ? 0 : 1));
    CHECK(job->tried);
    CHECK(job->NextToDo() == 0);
    CHECK(office.jobs.AwaitsExposure(job->id) == job);
    const int work = office.work;
    others.clear();
    REQUIRE(office.metered == 1);
    office.metered_later(0.75);
    CHECK(office.work == work + 1);
    CHECK_FALSE(office.jobs.AwaitsExposure(job->id));
    auto frame = office.jobs.Begin();
    REQUIRE(frame);
    CHECK(frame->job == job);
    CHECK(frame->view.metered_ev == 0.75);
    CHECK(job->ev == -2);
  }
}

TEST_CASE("A job that may have ended a master waits until no other frame is being rendered", "[jobs]") {
  Office office;
  const auto client = std::make_shared<Client>();
  REQUIRE(office.Ask(client, Walk(1)).has_value());
  REQUIRE(office.Ask(client, Walk(2, 100)).has_value());
  office.jobs.all()[1]->suspect = true;
  auto first = office.BeginAll();
  REQUIRE(first.size() == 1);
  first.clear();
  CHECK(office.BeginAll().size() == 1);  // of its two
}

}  // namespace quarry
