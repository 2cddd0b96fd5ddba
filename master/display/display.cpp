#include "master/display/display.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <nlohmann/json.hpp>
#include <random>
#include <utility>

#include "common/base/json_file.h"
#include "common/http/metrics.h"
#include "common/scene/default_view.h"
#include "master/display/welcome.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using nlohmann::ordered_json;

/// Viewers at once; more get a sentence.
constexpr size_t kMostViewers = 64;
constexpr double kReportEveryS = 1;
constexpr uint32_t kDefaultWidth = 1024, kDefaultHeight = 768;
uint64_t FirstFrame() { return kFirstLiveFrame | uint64_t{std::random_device{}()} << 24; }

}  // namespace

Result<std::unique_ptr<Display>> Display::Open(asio::io_context& io, const DisplayOptions& options,
                                               const Scene& scene, PartSelections& selections,
                                               const Environments& environments, WorkerRegistry& workers,
                                               QueryService& queries, SavedPictures::JobService jobs,
                                               std::function<void(const std::string&)> log) {
  QUARRY_ASSIGN(Access access, MakeAccess(options));
  std::unique_ptr<Display> display(new Display(io, options, scene, selections, environments, workers,
                                               std::move(access), std::move(jobs), std::move(log)));
  Display& d = *display;
  QUARRY_ASSIGN(d.server_,
                HttpServer::Open(io,
                                 {.listen = options.listen,
                                  .tls = options.tls,
                                  .most_message_bytes = kMostMessageBytes,
                                  .log = d.log_},
                                 {[&d](const HttpRequest& request) { return d.OnRequest(request); },
                                  [&d](const HttpRequest& request) { return d.MayUpgrade(request); },
                                  [&d](std::shared_ptr<WebSocket> socket, const HttpRequest&) {
                                    d.OnSocket(std::move(socket));
                                  }}));
  queries.Describe([&d](const Result<std::string>& description) { d.OnScene(description); });
  return display;
}

Display::Display(asio::io_context& io, const DisplayOptions& options, const Scene& scene,
                 PartSelections& selections, const Environments& environments, WorkerRegistry& workers,
                 Access access, SavedPictures::JobService jobs, std::function<void(const std::string&)> log)
    : io_(io),
      options_(options),
      workers_(workers),
      access_(std::move(access)),
      log_(std::move(log)),
      orders_(workers),
      dispatcher_(orders_, FirstFrame()),
      rays_([this](uint32_t worker, const RayOrder& order) {
        WorkerRecord* w = workers_.FindById(worker);
        if (!w) return;
        w->TellSelection(order.parts);
        w->connection->Send(MakeMessage(MessageType::kRay, order));
      }),
      stats_(scene.catalog().id),
      moving_(io),
      exact_(io),
      source_(scene.MakeSource([&io](std::function<void()> task) { asio::post(io, std::move(task)); })),
      saved_(io, std::move(jobs), [this] { return Now(); }),
      site_{io,
            moving_,
            exact_,
            dispatcher_,
            rays_,
            scene,
            selections,
            *source_,
            saved_,
            {scene.catalog().id, scene.catalog().meta.offset},
            {},
            {options.view_memory},
            [this] { AssignSoon(); },
            [this] { return Now(); },
            [this](double seconds) { stats_.TookFrame(seconds); },
            &environments},
      parts_page_(selections, scene.catalog().meta.offset) {}

Display::~Display() {
  server_.reset();
  viewers_.clear();
  departed_.clear();
  moving_.Join();
  exact_.Join();
}

double Display::Now() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string Display::url() const { return AddressOf(options_, access_, server_->port()); }

// --- Workers

void Display::WorkerReady(const WorkerRecord& worker) {
  dispatcher_.RemoveWorker(worker.id);
  dispatcher_.AddWorker(worker.id, worker.threads);
  rays_.RemoveWorker(worker.id);
  rays_.AddWorker(worker.id);
  failure_.clear();
  lost_.clear();
  SendState();
  AssignSoon();
}

void Display::WorkerGone(uint32_t id, const std::string& lost) {
  dispatcher_.RemoveWorker(id);
  rays_.RemoveWorker(id);
  lost_ = lost;
  if (dispatcher_.has_workers()) {
    failure_.clear();
    if (!lost.empty()) Notify(lost + " The other workers continue.");
  }
  SendState();
  AssignSoon();
}

void Display::Notify(const std::string& sentence) {
  const std::string json = ordered_json{{"type", "notice"}, {"message", sentence}}.dump(
      -1, ' ', false, ordered_json::error_handler_t::replace);
  for (const auto& [id, viewer] : viewers_) viewer->Send(json);
}

void Display::WorkerFailed(const std::string& sentence) {
  failure_ = sentence;
  SendState();
}

Status Display::OnTileDone(uint32_t worker, const TileDone& done, std::span<const std::byte> pixels) {
  QUARRY_ASSIGN(const auto tile, dispatcher_.Finish(worker, done, pixels.size()));
  AssignSoon();
  if (!tile) return {};
  if (const auto viewer = viewers_.find(tile->viewer); viewer != viewers_.end())
    viewer->second->Take(*tile, pixels);
  return {};
}

/// Once for all results that have arrived.
void Display::AssignSoon() {
  if (std::exchange(assigning_, true)) return;
  asio::post(io_, [this] {
    assigning_ = false;
    dispatcher_.Assign(Now());
    rays_.Assign(Now());
  });
}

// --- Viewers

HttpResponse Display::OnRequest(const HttpRequest& request) {
  if (const auto common = AnswerForAll(request, access_)) return *common;
  const std::string name = NameOfPage(request.path);
  if (name == "live") return OnLostUpgrade(request);
  if (name == "refusal") return refusals_.Answer(request);
  if (name == "access" || name == "parts" || SavedPictures::Names(name)) return OnPrivate(request, name);
  if (name != "stats" && name != "metrics") return PageFor(request, access_, "index.html");
  if (!access_.MayReadStatistics(request)) return Refused(403, "the session's token is needed");
  if (name == "stats")
    return {.content_type = "application/json", .body = stats_.Json(stats_.frames_per_s()) + "\n"};
  return {.content_type = kMetricsType, .body = stats_.Metrics()};
}

/// The answer to a browser that has the session.
HttpResponse Display::OnPrivate(const HttpRequest& request, const std::string& name) const {
  if (!access_.HasSession(request)) return Refused(403, "the session's cookie is missing");
  if (name == "parts") return parts_page_.Answer(request);
  return name == "access" ? HttpResponse{.body = access_.token()} : saved_.Fetch(name);
}

/// A request at the WebSocket's address without an upgrade.
HttpResponse Display::OnLostUpgrade(const HttpRequest& request) {
  const std::string swallowed = SwallowedUpgrade(request);
  if (!swallowed.empty()) refusals_.Note(request, swallowed);
  HttpResponse answer = Refused(426, swallowed.empty() ? "this address is for WebSockets" : swallowed);
  answer.headers.emplace_back("Upgrade", "websocket");
  return answer;
}

HttpResponse Display::MayUpgrade(const HttpRequest& request) {
  HttpResponse answer = MayOpen(request);
  if (answer.status != 101) refusals_.Note(request, answer.body.substr(0, answer.body.size() - 1));
  return answer;
}

HttpResponse Display::MayOpen(const HttpRequest& request) const {
  if (NameOfPage(request.path) != "live") return Refused(404, "there is no such WebSocket");
  if (!access_.HostPermitted(request) || !access_.OriginPermitted(request))
    return Refused(403, "The address of this page is not allowed; add it with --viewer-url.");
  if (!access_.HasSession(request)) return Refused(403, "The session's cookie is missing.");
  return {.status = 101};
}

void Display::OnSocket(std::shared_ptr<WebSocket> socket) {
  if (viewers_.size() >= kMostViewers) {  // by a text, because a page cannot read a WebSocket's refusal
    socket->SendText(ordered_json{
        {"type", "error"},
        {"message", fmt::format("There are already {} viewers, the most allowed.", kMostViewers)}}
                         .dump());
    return socket->Close();
  }
  const uint32_t id = next_viewer_++;
  log_(fmt::format("viewer {} has connected from {}", id, socket->peer()));
  const auto viewer =
      std::make_shared<Viewer>(site_, id, std::move(socket), [this, id](const std::string& why) {
        log_(fmt::format("viewer {} is gone: {}", id, why));
        const auto it = viewers_.find(id);
        if (it == viewers_.end()) return;
        frames_of_gone_ += it->second->frames_sent();
        abandoned_of_gone_ += it->second->abandoned();
        departed_.push_back(std::move(viewers_.extract(it).mapped()));
        AssignSoon();
      });
  viewers_.emplace(id, viewer);
  if (summary_) Welcome(viewer);
}

void Display::OnScene(const Result<std::string>& description) {
  const auto read = [&]() -> Result<SceneSummary> {
    if (!description) return tl::unexpected<Error>(description.error());
    static const std::string kName = "the scene's description";
    QUARRY_ASSIGN(const auto json, ParseJson<nlohmann::json>(*description, kName));
    return ReadSceneSummary(JsonValue(json, kName));
  };
  summary_ = read();
  if (*summary_) {
    if (options_.up_axis != 0 && options_.up_axis != (*summary_)->framing.up_axis) {
      (*summary_)->framing.up_axis = options_.up_axis;
      (*summary_)->framing.inside.reset();  // it is valid only for the axis with which it was found
      (*summary_)->framing.interior = false;
    }
    site_.defaults.view = DefaultView(**summary_, kDefaultWidth, kDefaultHeight);
    site_.defaults.view.up_axis = options_.up_axis;
    welcome_ = MakeWelcome(options_.name, options_.store, **summary_, site_.scene.catalog(),
                           *site_.environments, site_.defaults, site_.memory.most_pixels());
  }
  for (const auto& [id, viewer] : std::map(viewers_)) Welcome(viewer);
}

void Display::Welcome(const std::shared_ptr<Viewer>& viewer) {
  if (!*summary_) return viewer->End(summary_->error().message);
  viewer->Start(welcome_);
  if (!state_.empty()) viewer->SendState(state_);
}

/// Informs viewers whether there is a worker.
void Display::SendState() {
  const bool works = dispatcher_.has_workers();
  const char* const state = works ? "ok" : failure_.empty() ? "no-workers" : "failed";
  const std::string message = works               ? ""
                              : !failure_.empty() ? failure_
                              : !lost_.empty()
                                  ? lost_ + " The picture continues when a worker joins."
                                  : "No worker is connected. The picture continues when one joins.";
  std::string json = ordered_json{{"type", "state"}, {"state", state}, {"message", message}}.dump(
      -1, ' ', false, ordered_json::error_handler_t::replace);
  if (json == state_) return;
  state_ = std::move(json);
  for (const auto& [id, viewer] : viewers_) viewer->SendState(state_);
}

DisplayCounters Display::Counters() const {
  DisplayCounters counters{viewers_.size(), frames_of_gone_, abandoned_of_gone_};
  for (const auto& [id, viewer] : viewers_) {
    counters.frames_sent += viewer->frames_sent();
    counters.abandoned_views += viewer->abandoned();
  }
  return counters;
}

void Display::Tick() {
  const double now_s = Now();
  departed_.clear();
  saved_.Tick();
  stats_.Sample(now_s, workers_, Counters());
  SendState();
  AssignSoon();  // late tiles
  if (now_s - reported_s_ < kReportEveryS) return;
  reported_s_ = now_s;
  for (const auto& [id, viewer] : std::map(viewers_)) {  // a viewer may end
    viewer->Sample(now_s);
    viewer->Send(stats_.Json(viewer->frames_per_s()));
  }
}

}  // namespace quarry
