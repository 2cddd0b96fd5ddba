#include "master/display/viewer.h"

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "tests/support/cluster/live_cluster.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/row_scene.h"

// A browser that does not read its messages.

namespace quarry {
namespace {

using nlohmann::json;

/// The browser's end. The system takes nothing until Take() is called.
class Socket final : public WebSocket {
 public:
  void Start(std::function<void(std::string)> on_text, std::function<void(const Error&)>) override {
    text = std::move(on_text);
  }
  void SendText(std::string message) override {
    queued += message.size();
    texts.push_back(json::parse(message));
  }
  void SendBinary(std::shared_ptr<const Bytes> message, std::function<void()> taken) override {
    queued += message->size();
    ++frames;
    waiting.emplace_back(message->size(), std::move(taken));
  }
  void Close() override { closed = true; }
  uint64_t queued_bytes() const override { return queued; }
  const std::string& peer() const override { return peer_; }

  /// The system takes the oldest frame.
  void Take() {
    const auto [bytes, taken] = std::move(waiting.front());
    waiting.pop_front();
    queued -= bytes;
    taken();
  }

  std::function<void(std::string)> text;
  std::vector<json> texts;
  std::deque<std::pair<uint64_t, std::function<void()>>> waiting;
  uint64_t queued = 0, frames = 0;
  bool closed = false;

 private:
  const std::string peer_ = "127.0.0.1:1";
};

/// A viewer before a worker.
struct Watching {
  Watching() {
    cluster.dispatcher.AddWorker(1, 1);
    viewer =
        std::make_shared<Viewer>(site, 1, socket, [this](const std::string& sentence) { why = sentence; });
    viewer->Start("{}");
  }
  ~Watching() {
    moving.Join();
    exact.Join();
  }
  void Say(const json& message) { socket->text(message.dump()); }
  void Want(double x) {
    const View view = test::Looking({x, -20, 0}, {x, 10, 0}, 64, 48);
    Say({{"type", "view"},
         {"input", ++input},
         {"time", 0},
         {"moving", true},
         {"view", ViewToJson(view, {"", 0.0}, {})}});
  }
  /// All that a browser could have seen.
  void AcknowledgeAll() {
    for (uint64_t frame = 1; frame <= socket->frames; ++frame) Say({{"type", "ack"}, {"frame", frame}});
  }
  /// So many milliseconds, in which a worker traces and frames are encoded.
  void Pass(int ms) {
    for (int i = 0; i < ms; ++i) {
      now_s += 1e-3;
      cluster.dispatcher.Assign(now_s);
      if (!cluster.orders.empty())
        if (const auto done = cluster.RunOne()) viewer->Take(done->tile, done->pixels);
      viewer->Advance();
      int behind = 2;  // threads with frames before these, which nobody sees
      for (EncodingThread* thread : {&moving, &exact})
        thread->Encode({std::make_shared<DueFrame>(), {}, 80, std::make_shared<std::optional<ToneTable>>()},
                       [&behind](const Result<EncodedFrame>&) { --behind; });
      const auto work = boost::asio::make_work_guard(io);
      io.restart();
      while (behind > 0) io.run_one();
    }
  }

  test::Row row;
  test::LiveCluster cluster{*row.scene};
  std::vector<RayOrder> ray_orders;
  RayDispatcher rays{[this](uint32_t, const RayOrder& order) { ray_orders.push_back(order); }};
  boost::asio::io_context io;
  EncodingThread moving{io}, exact{io};
  double now_s = 100;
  uint64_t input = 0;
  std::string why;  ///< it is gone
  const std::unique_ptr<VoxelSource> source =
      row.scene->MakeSource([this](std::function<void()> task) { boost::asio::post(io, std::move(task)); });
  SavedPictures saved{io,
                      {[](const auto&, const JobRequest&) { return Status{}; }, [](const auto&) {},
                       [](uint64_t) { return FrameMemory::Reservation(); }},
                      [this] { return now_s; }};
  PartSelections selections{row.scene->store()};
  const Environments environments{io, {}};
  ViewerSite site{io,
                  moving,
                  exact,
                  cluster.dispatcher,
                  rays,
                  *row.scene,
                  selections,
                  *source,
                  saved,
                  {},
                  {test::Looking({0, -20, 0}, {0, 10, 0}, 64, 48), {}},
                  {1u << 20},
                  [] {},
                  [this] { return now_s; },
                  [](double) {},
                  &environments};
  const std::shared_ptr<Socket> socket = std::make_shared<Socket>();
  std::shared_ptr<Viewer> viewer;
};

}  // namespace

TEST_CASE("A viewer that acknowledges frames still unsent gets two frames, and is disconnected", "[live]") {
  Watching watching;
  Socket& socket = *watching.socket;
  for (int i = 0; i < 20; ++i) {
    watching.Want(0.1 * i);
    watching.Pass(40);
    watching.AcknowledgeAll();
  }
  CHECK(socket.frames == ViewPacer::kMostUnderWay);
  // With each frame that is taken another one comes.
  socket.Take();
  watching.Pass(40);
  CHECK(socket.frames == ViewPacer::kMostUnderWay + 1);
  CHECK(socket.waiting.size() == ViewPacer::kMostUnderWay);
  watching.viewer->Sample(watching.now_s);
  CHECK_FALSE(socket.closed);
  watching.now_s += 60;
  watching.viewer->Sample(watching.now_s);
  CHECK(socket.closed);
  CHECK(watching.why == "this page does not read the frames sent to it");
}

TEST_CASE("A viewer that reads no texts gets only required ones, and is disconnected when it keeps asking",
          "[live]") {
  Watching watching;
  Socket& socket = *watching.socket;
  watching.Want(0);
  for (int i = 0; i < 1000; ++i)
    watching.viewer->Send(json{{"type", "stats"}, {"text", std::string(1000, 'x')}}.dump());
  CHECK(socket.queued < 64 << 10);
  const size_t told = socket.texts.size();
  watching.viewer->SendState(R"({"type":"state"})");
  CHECK(socket.texts.size() == told);
  socket.queued = 0;
  watching.viewer->Sample(watching.now_s);  // now it is told
  CHECK(socket.texts.back() == json{{"type", "state"}});
  // Picks are answered, and replaced ones at once.
  for (int pick = 0; pick < 20; ++pick) watching.Say({{"type", "pick"}, {"pick", pick}, {"x", 1}, {"y", 1}});
  CHECK(socket.texts.back() == json{{"type", "picked"}, {"pick", 11}, {"hit", nullptr}, {"replaced", true}});
  socket.queued = 1 << 20;
  watching.Say({{"type", "pick"}, {"pick", 20}, {"x", 1}, {"y", 1}});
  CHECK(socket.closed);
}

TEST_CASE("Messages that cannot be read are answered, and a flood of them disconnects the viewer", "[live]") {
  Watching watching;
  Socket& socket = *watching.socket;
  for (int i = 0; i < 20; ++i) {
    socket.text("{");
    REQUIRE(socket.texts.back().at("type") == "refused");
  }
  CHECK_FALSE(socket.closed);
  watching.now_s += 10;  // ten are forgiven
  for (int i = 0; i < 10; ++i) socket.text("[]");
  CHECK_FALSE(socket.closed);
  socket.text("{");
  CHECK(socket.closed);
  CHECK(socket.texts.back().at("type") == "error");
}

TEST_CASE("A viewer's lists of parts are resolved once, and views name them by the answer's id",
          "[live][parts]") {
  Watching w;
  const auto last = [&] { return w.socket->texts.back(); };
  w.Say({{"type", "select"}, {"hide", {"nothing"}}});
  CHECK(last()["type"] == "selection");
  CHECK_THAT(last()["error"].get<std::string>(),
             Catch::Contains("no part is named `nothing`; the nearest is `part`"));
  w.Say({{"type", "select"}, {"colors", {{{"parts", {"p*"}}, {"color", {1, 0, 0}}}}}});
  REQUIRE(last().contains("id"));
  CHECK(last()["hidden"] == 0);
  const std::string id = last()["id"];
  const auto view = [&](const std::string& selection) {
    json message = {{"type", "view"}, {"input", 1}, {"time", 0}, {"moving", false}, {"view", json::object()}};
    message["view"] = {{"size", {64, 48}}, {"selection", selection}};
    w.Say(message);
  };
  const size_t texts = w.socket->texts.size();
  view(id);
  CHECK(w.socket->texts.size() == texts);  // nothing is refused
  view("00000000000000aa");
  CHECK((last()["type"] == "selection" && last()["unknown"] == "00000000000000aa"));
  view("xyz");
  CHECK_THAT(last()["message"].get<std::string>(), Catch::Contains("must be an id in hexadecimal digits"));
  w.Say({{"type", "select"}});
  CHECK((last()["id"] == "" && last()["hidden"] == 0));
  CHECK(w.why.empty());
}

TEST_CASE("A pick is answered whatever hit a worker reports; no ray is traced for a viewer that is gone",
          "[live]") {
  Watching watching;
  watching.rays.AddWorker(1);
  watching.Want(0);
  // Answers that cannot be: another triangle, an index beyond the voxel's, a voxel beyond the scene's, no
  // hit.
  const auto answer = [&](uint32_t triangle, uint32_t voxel, uint32_t local) {
    watching.Say({{"type", "pick"}, {"pick", 7}, {"x", 32}, {"y", 24}});
    watching.rays.Assign(watching.now_s);
    const RayOrder order = watching.ray_orders.back();
    const size_t before = watching.socket->texts.size();
    watching.rays.Finish(1, {order.ray, order.lease, 1, triangle, voxel, local});
    const auto work = boost::asio::make_work_guard(watching.io);
    watching.io.restart();
    while (watching.socket->texts.size() == before) watching.io.run_one();
    return watching.socket->texts.back();
  };
  const json none{{"type", "picked"}, {"pick", 7}, {"hit", nullptr}};
  json damaged = none;
  damaged["error"] = "the triangle is not in its voxel";
  CHECK(answer(4000, 2, 0) == damaged);
  CHECK(answer(4, 2, 4000) == damaged);
  CHECK(answer(4, 4000, 0) == none);
  CHECK(answer(kNoIndex, 0, 0) == none);
  CHECK_FALSE(answer(4, 2, 0).at("hit").is_null());
  watching.Say({{"type", "pick"}, {"pick", 8}, {"x", 32}, {"y", 24}});
  watching.rays.Assign(watching.now_s);
  const RayOrder last = watching.ray_orders.back();
  const size_t told = watching.socket->texts.size();
  watching.socket->text = {};
  watching.viewer.reset();
  watching.rays.Finish(1, {last.ray, last.lease, 1, 4, 2, 0});
  CHECK(watching.socket->texts.size() == told);
}

}  // namespace quarry
