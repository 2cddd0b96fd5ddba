// Plays a browser that may send anything: texts to a viewer, tiles that workers trace for it,
// acknowledgements and waits; and requests for entry. Messages to the browser must be as PROTOCOL.md states.
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <nlohmann/json.hpp>
#include <string>

#include "common/engine/scene.h"
#include "common/scene/default_view.h"
#include "master/display/access.h"
#include "master/display/viewer.h"
#include "tests/fuzz/session_script.h"

namespace quarry::fuzz {
namespace {

constexpr const char* kToken = "the-token-of-this-session-0123456789";

/// The browser's end.
class Socket final : public WebSocket {
 public:
  void Start(std::function<void(std::string)> on_text, std::function<void(const Error&)>) override {
    text = std::move(on_text);
  }
  void SendText(std::string message) override {
    if (!nlohmann::json::accept(message)) std::abort();
  }
  void SendBinary(std::shared_ptr<const Bytes> message, std::function<void()> taken) override {
    uint32_t length = 0;
    if (message->size() < sizeof length) std::abort();
    std::memcpy(&length, message->data(), sizeof length);
    if (message->size() - sizeof length < length) std::abort();
    const auto header = nlohmann::json::parse(AsText(std::span(*message).subspan(sizeof length, length)));
    size_t bytes = sizeof length + length;
    for (const auto& stripe : header.at("stripes")) bytes += stripe.at("bytes").get<size_t>();
    if (bytes != message->size() || !(header.at("traced").get<double>() <= 1)) std::abort();
    frames.push_back(header.at("frame").get<uint64_t>());
    if (frames.size() > ViewPacer::kMostUnderWay) std::abort();  // more than are acknowledged
    if (taken) taken();
  }
  void Close() override { closed = true; }
  uint64_t queued_bytes() const override { return 0; }
  const std::string& peer() const override { return peer_; }

  std::function<void(std::string)> text;
  std::deque<uint64_t> frames;  ///< not acknowledged
  bool closed = false;

 private:
  const std::string peer_ = "127.0.0.1:1";
};

/// Workers that answer with any pixels.
struct Workers final : LiveDispatcher::Sink {
  void SetUp(uint32_t, FrameId, const View&) override {}
  void Order(uint32_t worker, TileOrder order) override { orders.emplace_back(worker, std::move(order)); }
  void End(uint32_t, std::vector<FrameId>) override {}
  std::deque<std::pair<uint32_t, TileOrder>> orders;
};

/// A scene's summary whose views are good.
const ViewDescription& Defaults() {
  static const ViewDescription defaults = [] {
    const SceneMeta& meta = Store().catalog().meta;
    SceneSummary summary;
    summary.framing = {meta.bounds_lower, meta.bounds_upper, {meta.bounds_lower, meta.bounds_upper}};
    return ViewDescription{DefaultView(summary, 64, 48), {}};
  }();
  return defaults;
}

/// The script up to the end of a line.
std::string Line(Script& script) {
  std::string line;
  while (!script.over()) {
    const char letter = static_cast<char>(script.Byte());
    if (letter == '\n') break;
    line += letter;
  }
  return line;
}

/// Waits until both threads have encoded their frames, and passes the frames on.
void Drain(boost::asio::io_context& io, EncodingThread& moving, EncodingThread& exact) {
  int left = 2;
  for (EncodingThread* thread : {&moving, &exact})
    thread->Encode({std::make_shared<DueFrame>(), {}, 80, std::make_shared<std::optional<ToneTable>>()},
                   [&left](const Result<EncodedFrame>&) { --left; });
  const auto work = boost::asio::make_work_guard(io);
  io.restart();
  while (left > 0) io.run_one();
  io.poll();
}

void AskToComeIn(Script& script) {
  static const Access access = *Access::Make(
      {.token = kToken, .hosts = {"10.0.0.1"}, .viewer_urls = {*ParseViewerUrl("https://a.example/b/")}});
  HttpRequest request;
  request.method = "GET";
  request.path = "/" + Line(script);
  request.query = Line(script);
  std::string all = request.query;
  for (uint32_t headers = script.Below(5); headers > 0; --headers) {
    static const char* const kNames[] = {"host", "origin", "cookie", "authorization", "x-forwarded-for"};
    request.headers.emplace_back(kNames[script.Below(5)], Line(script));
    all += request.headers.back().second;
  }
  const bool may =
      access.HasSession(request) || access.HasToken(request) || access.MayReadStatistics(request);
  if (may && all.find(kToken) == std::string::npos) std::abort();
  if (access.HostPermitted(request)) (void)access.OriginPermitted(request);
  (void)access.SetCookie(request);
  (void)ParseViewerUrl(request.query);
}

}  // namespace

std::vector<std::vector<uint8_t>> Seeds() {
  const auto play = [](const std::string& text) { return std::vector<uint8_t>(text.begin(), text.end()); };
  const std::string view =
      R"({"type":"view","input":1,"time":2,"moving":false,"view":{"camera":{"eye":[9,9,9],"at":[0,0,0],"up":[0,0,1],"fov":45},"size":[64,48],)"
      R"("mode":"raycast","spp":2}})";
  std::string tiles;
  for (int i = 0; i < 40; ++i)
    tiles +=
        "t\x07"
        "w";
  return {play("m" + view + "\n" + tiles + "a" + tiles + "a" + tiles),
          play("m{\"type\":\"settings\",\"step\":1,\"owners\":true}\nm" + view + "\n" + tiles +
               "m{\"type\":\"pick\",\"pick\":1,\"x\":3,\"y\":4}\n" + tiles),
          play(std::string("r\ntoken=") + kToken + "\n" + '\2' + '\0' + "localhost:1\n" + '\1' +
               "http://localhost:1\n"),
          play("m{\"type\":\"ack\",\"frame\":1}\nm[]\n"), play("m{\"type\":\"save\",\"save\":1}\nm[]\n")};
}

}  // namespace quarry::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace quarry;
  using namespace quarry::fuzz;
  static const Scene scene = *Scene::Open(StorePath());
  Script script(data, size);
  static boost::asio::io_context io;
  static EncodingThread moving(io), exact(io);
  Workers workers;
  LiveDispatcher dispatcher(workers, kFirstLiveFrame);
  dispatcher.AddWorker(1, 1);
  double now_s = 1;
  const auto source =
      scene.MakeSource([](std::function<void()> task) { boost::asio::post(io, std::move(task)); });
  PartSelections selections(scene.store());
  const Environments environments(io, {});
  // No job is ever done here; a viewer may ask for many.
  SavedPictures saved(io,
                      {[](const auto&, const JobRequest&) { return Status{}; }, [](const auto&) {},
                       [](uint64_t) { return FrameMemory::Reservation(); }},
                      [&] { return now_s; });
  std::deque<std::pair<uint32_t, RayOrder>> asked;
  RayDispatcher rays([&](uint32_t worker, const RayOrder& order) { asked.emplace_back(worker, order); });
  rays.AddWorker(1);
  ViewerSite site{io,
                  moving,
                  exact,
                  dispatcher,
                  rays,
                  scene,
                  selections,
                  *source,
                  saved,
                  {scene.catalog().id, {}},
                  Defaults(),
                  {1u << 20},
                  [] {},
                  [&] { return now_s; },
                  [](double) {},
                  &environments};
  const auto socket = std::make_shared<Socket>();
  bool gone = false;
  auto viewer = std::make_shared<Viewer>(site, 1, socket, [&](const std::string& why) {
    if (gone || why.empty()) std::abort();
    gone = true;
  });
  viewer->Start("{}");
  for (int steps = 0; !script.over() && steps < 2000; ++steps) {
    switch (script.Byte()) {
      case 'm':
        socket->text(Line(script));
        break;
      case 'r':
        AskToComeIn(script);
        break;
      case 'a':
        if (socket->frames.empty()) break;
        socket->text(R"({"type":"ack","frame":)" + std::to_string(socket->frames.front()) + "}");
        socket->frames.pop_front();
        break;
      case 't': {
        const uint8_t fill = script.Byte();
        rays.Assign(now_s);
        if (!asked.empty()) {
          const auto [worker, order] = asked.front();
          asked.pop_front();
          rays.Finish(worker, {order.ray, order.lease, 1, fill, fill % 4u, fill / 4u});
        }
        dispatcher.Assign(now_s);
        if (workers.orders.empty()) break;
        const auto [worker, order] = std::move(workers.orders.front());
        workers.orders.pop_front();
        const Tile& area = order.area;
        const uint32_t layers = area.form == PixelForm::kMeans ? 1 : 0;
        const Bytes pixels(size_t{area.columns()} * area.rows() * BytesPerPoint(area.form, layers),
                           std::byte{fill});
        const auto tile =
            dispatcher.Finish(worker, {order.frame, order.tile, order.lease, 1, 0, fill}, pixels.size());
        if (tile && *tile) viewer->Take(**tile, pixels);
        break;
      }
      default:  // time passes, and encoded frames are sent
        now_s += 0.05;
        viewer->Advance();
        Drain(io, moving, exact);
    }
    if (site.memory.taken > site.memory.most) std::abort();
  }
  if (gone != socket->closed) std::abort();
  Drain(io, moving, exact);
  viewer.reset();
  if (site.memory.taken != 0) std::abort();
  return 0;
}
