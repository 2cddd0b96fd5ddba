#include "master/jobs/jobs.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <thread>
#include <utility>

#include "common/base/resource.h"
#include "common/base/size.h"
#include "master/jobs/statistics.h"
#include "master/pictures/image_output.h"

namespace quarry {
namespace {

namespace asio = boost::asio;

/// Bytes queued for a client beyond which no further frame is queued. Bounds memory.
constexpr uint64_t kFullQueueBytes = 32u << 20;
/// Bytes that pings and progress of all clients stay below.
constexpr uint64_t kBesideImages = 1u << 20;
/// Bytes of the largest image: a message's limit.
constexpr uint64_t kMostImageBytes = 0xF0000000;
/// Frames on their way to the disk beyond which no other begins. Bounds memory.
constexpr int kMostEncoding = 4;
/// Seconds that a job without a spool waits for a client to come back.
constexpr double kClientGraceS = 20;

/// The beginning of a job's id, enough for logs.
std::string ShortId(const std::string& id) { return id.substr(0, 8); }

}  // namespace

Jobs::Jobs(asio::io_context& io, const SceneFacts& scene, std::optional<Spool> spool, uint64_t frame_memory,
           Callbacks callbacks)
    : io_(io),
      scene_(scene),
      spool_(std::move(spool)),
      memory_(frame_memory),
      callbacks_(std::move(callbacks)),
      encoder_(std::make_unique<asio::thread_pool>(1)) {}

Jobs::~Jobs() { stop_.request_stop(); }

void Jobs::TakeUp() {
  if (!spool_) return;
  for (Spool::Found& found : spool_->Jobs(callbacks_.log)) {
    if (const Status fits = memory_.CheckJob(found.job, JobsBytes()); !fits) {
      callbacks_.log(fmt::format("job {} stays in the spool: {}", found.id, fits.error().message));
      continue;
    }
    if (const Status known = Complete(found.job); !known) {
      callbacks_.log(fmt::format("job {} stays in the spool: {}", found.id, known.error().message));
      continue;
    }
    auto job = std::make_shared<Job>(found.id, std::move(found.job));
    job->suspect = found.tries > 0;
    for (size_t f = 0; f < found.finished.size(); ++f)
      if (found.finished[f]) job->states[f] = Job::FrameState::kFinished;
    callbacks_.log(fmt::format("continuing job {}: {} of {} frames are done", job->id,
                               std::count(found.finished.begin(), found.finished.end(), true),
                               found.finished.size()));
    jobs_.push_back(std::move(job));
  }
}

Status Jobs::Ask(const std::shared_ptr<Connection>& client, JobRequest request) {
  const std::string id = JobId(scene_.id, request.job);
  const auto found = std::find_if(jobs_.begin(), jobs_.end(), [&](const auto& j) { return j->id == id; });
  std::shared_ptr<Job> job;
  if (found != jobs_.end()) {
    job = *found;
    callbacks_.log(fmt::format("job {} is also requested by {}", ShortId(id), client->peer()));
  } else {
    QUARRY_TRY(memory_.CheckJob(request.job, JobsBytes()));
    if (spool_) QUARRY_TRY(spool_->CheckNotSetAside(id));
    QUARRY_TRY(Complete(request.job));
    job = std::make_shared<Job>(id, std::move(request.job));
    callbacks_.log(fmt::format("job {} from {}: {}", ShortId(id), client->peer(), Describe(job->job)));
    job->tried = true;  // the spool notes a new job's first try with it
    jobs_.push_back(job);
    // Frames that the client has are rendered only if another client asks for them.
    std::fill_n(job->states.begin(), request.have, Job::FrameState::kFinished);
    if (spool_)
      asio::post(*encoder_,
                 [this, job] { WriteToSpool(*job, [&] { return spool_->Begin(job->id, job->job); }); });
  }
  job->clients.push_back({client, request.have});
  Deliver(job);
  callbacks_.on_work();
  return {};
}

Status Jobs::Complete(RenderJob& job) const {
  return callbacks_.complete ? callbacks_.complete(job.view) : Status{};
}

uint64_t Jobs::JobsBytes() const {
  uint64_t bytes = 0;
  for (const auto& job : jobs_) bytes += JobBytes(job->states.size());
  return bytes;
}

bool Jobs::ForgetClient(const std::shared_ptr<Connection>& client, double now_s) {
  bool waited = false;
  for (const auto& job : jobs_) {
    const size_t frames = job->states.size();
    if (std::erase_if(job->clients, [&](const Job::Client& c) {
          waited |= c.connection == client && c.next < frames;
          return c.connection == client;
        }) > 0)
      job->alone_since_s = now_s;
  }
  return waited;
}

std::optional<JobFrame> Jobs::Begin() {
  if (rests_ || encoding_ >= kMostEncoding || !suspect_.expired()) return std::nullopt;
  for (const auto& job : jobs_) {
    const size_t index = job->NextToDo();
    if (index == job->states.size()) continue;
    const bool needs_grey = NoiseBlocks::Needs(job->job.view) && !job->metered;
    if (!needs_grey && !HasRoom(*job)) return std::nullopt;
    if (job->suspect && memory_.used() > 0) return std::nullopt;
    if (spool_ && !job->tried) spool_->NoteTry(job->id);
    job->tried = true;
    if (needs_grey) {
      Meter(job);
      if (!job->metered && job->suspect) return std::nullopt;
      if (!job->metered) continue;
      if (!HasRoom(*job)) return std::nullopt;
    }
    job->states[index] = Job::FrameState::kActive;
    JobFrame begun{job, index, FrameView(job->job, index), nullptr};
    begun.view.metered_ev = job->metered.value_or(0);
    begun.memory = memory_.Take(FrameBytes(begun.view, job->job.format));
    if (job->suspect) suspect_ = begun.memory;
    Meter(job);
    return begun;
  }
  return std::nullopt;
}

/// Where no frame is under way that could make room, images that wait for clients are dropped, to be rendered
/// again.
bool Jobs::HasRoom(const Job& job) {
  const uint64_t bytes = FrameBytes(job.job.view, job.job.format);
  const auto fits = [&] { return memory_.used() + QueuedBytes() + bytes <= memory_.for_frames(); };
  const bool under_way = encoding_ > 0 || std::ranges::any_of(jobs_, [](const auto& j) {
                           return std::ranges::count(j->states, Job::FrameState::kActive) > 0;
                         });
  while (!fits() && !under_way && DropLastImage()) {
  }
  return fits() || !under_way;
}

bool Jobs::DropLastImage() {
  for (auto job = jobs_.rbegin(); job != jobs_.rend(); ++job)
    for (size_t f = (*job)->finished.size(); f-- > 0;) {
      if ((*job)->finished[f].image.empty()) continue;
      (*job)->finished[f] = {};
      (*job)->states[f] = Job::FrameState::kToDo;
      return true;
    }
  return false;
}

/// Bytes of images on their way to clients.
uint64_t Jobs::QueuedBytes() const {
  uint64_t bytes = 0;
  for (const auto& job : jobs_)
    for (const Job::Client& client : job->clients) bytes += client.connection->queued_bytes();
  return bytes;
}

bool Jobs::MaySend(uint64_t image_bytes) const {
  const uint64_t queued = QueuedBytes();
  return queued < kBesideImages ||
         queued + image_bytes <= std::min(kFullQueueBytes, memory_.for_frames() / 8);
}

std::vector<JobFrame> Jobs::Upcoming(size_t most) const {
  std::vector<JobFrame> upcoming;
  for (const auto& job : jobs_)
    for (size_t index = job->NextToDo(); index < job->states.size() && upcoming.size() < most; ++index)
      if (job->states[index] == Job::FrameState::kToDo)
        upcoming.push_back({job, index, FrameView(job->job, index), nullptr});
  return upcoming;
}

void Jobs::Finish(JobFrame frame, std::vector<uint32_t> pixels, std::string statistics) {
  ++encoding_;
  const std::shared_ptr<Job> job = frame.job;
  waiting_.push_back({std::move(frame), std::move(pixels), std::move(statistics)});
  if (job->ev) EncodeWaiting(job);
}

void Jobs::Encode(Rendered rendered, double ev) {
  asio::post(*encoder_, [this, ev, frame = std::move(rendered.frame), pixels = std::move(rendered.pixels),
                         statistics = std::move(rendered.statistics)]() mutable {
    auto image =
        WithinLimits([&] { return EncodeImage(frame.view, frame.job->job.format, scene_, ev, pixels); });
    pixels = {};
    statistics = WithExposure(statistics, ev);
    if (image && image->size() > kMostImageBytes)
      image = quarry::Fail(fmt::format(
          "the picture takes {} as {}, and at most {} can be sent; render parts of it with --crop",
          FormatSize(image->size()), frame.job->job.format.name, FormatSize(kMostImageBytes)));
    if (image && spool_)
      WriteToSpool(*frame.job,
                   [&] { return spool_->WriteFrame(frame.job->id, frame.job->job, frame.index, *image); });
    asio::post(io_, [this, job = frame.job, memory = std::move(frame.memory), index = frame.index,
                     image = std::move(image), statistics = std::move(statistics)]() mutable {
      memory.reset();
      OnImage(job, index, std::move(image), std::move(statistics));
    });
  });
}

/// Sets the EV of the job's PNGs, and that by which its noise is judged, or has them metered, once.
void Jobs::Meter(const std::shared_ptr<Job>& job) {
  if (std::exchange(job->metering, true)) return;
  const ImageFormat& format = job->job.format;
  const bool is_png = format.name == "png", is_metered = InfoOf(job->job.view.mode).metered;
  const bool has_noise = NoiseBlocks::Needs(job->job.view);
  if (is_png && format.exposure)
    job->ev = format.exposure;
  else if (!is_png || !is_metered)
    job->ev = 0;
  if (!is_metered) job->metered = 0;
  if (is_metered && (!job->ev || has_noise))
    callbacks_.meter(*job, [this, job](double ev) { Metered(job, ev); });
}

/// Encodes the frames that have waited for their job's exposure, and lets frames with a noise begin.
void Jobs::Metered(const std::shared_ptr<Job>& job, double metered) {
  job->metered = metered;
  if (!job->ev) job->ev = metered;
  EncodeWaiting(job);
  if (NoiseBlocks::Needs(job->job.view)) callbacks_.on_work();
}

/// Encodes the job's frames that are rendered. Requires: its exposure is known.
void Jobs::EncodeWaiting(const std::shared_ptr<Job>& job) {
  const double ev = *job->ev;
  for (Rendered& rendered : std::exchange(waiting_, {}))
    if (rendered.frame.job == job)
      Encode(std::move(rendered), ev);
    else
      waiting_.push_back(std::move(rendered));
  EndRest();
}

std::shared_ptr<Job> Jobs::AwaitsExposure(const std::string& id) const {
  for (const auto& job : jobs_)
    if (job->id == id && NoiseBlocks::Needs(job->job.view) && !job->metered) return job;
  for (const Rendered& rendered : waiting_)
    if (rendered.frame.job->id == id) return rendered.frame.job;
  return nullptr;
}

/// Repeats `write` until it succeeds, for a full disk may get space, or the job is over.
template <class Write>
void Jobs::WriteToSpool(const Job& job, Write write) const {
  for (bool reported = false; !job.over && !stop_.stop_requested(); reported = true) {
    const Status status = write();
    if (status) break;
    if (!reported) callbacks_.log(status.error().message + "; trying every second");
    std::this_thread::sleep_for(std::chrono::seconds(1));
  }
  if (job.over) spool_->Remove(job.id);  // it may have ended while this was at work
}

void Jobs::Rest(std::function<void()> done) {
  rests_ = true;
  rested_ = std::move(done);
  EndRest();
}

void Jobs::EndRest() {
  if (!rested_ || !waiting_.empty()) return;
  std::vector<std::string> tried;
  for (const auto& job : jobs_)
    if (job->tried) tried.push_back(job->id);
  asio::post(*encoder_, [this, tried = std::move(tried), done = std::exchange(rested_, {})] {
    for (const std::string& id : tried) spool_->TakeBackTry(id);
    asio::post(io_, done);
  });
}

void Jobs::OnImage(const std::shared_ptr<Job>& job, size_t index, Result<Bytes> image,
                   std::string statistics) {
  --encoding_;
  callbacks_.on_work();
  if (std::find(jobs_.begin(), jobs_.end(), job) == jobs_.end()) return;
  if (!image) return Fail(job, image.error().message);
  job->states[index] = Job::FrameState::kFinished;
  job->suspect = false;
  auto memory = memory_.Take(image->size());
  job->finished[index] = {std::move(*image), std::move(statistics), std::move(memory)};
  Deliver(job);
}

void Jobs::Fail(std::shared_ptr<Job> job, const std::string& sentence) {
  callbacks_.log(fmt::format("job {} cannot be done: {}", ShortId(job->id), sentence));
  for (const Job::Client& client : job->clients)
    client.connection->Send(MakeMessage(MessageType::kFailure, Failure{sentence}));
  Remove(std::move(job));
}

void Jobs::Remove(std::shared_ptr<Job> job) {
  callbacks_.on_over(*job);
  job->over = true;
  encoding_ -= static_cast<int>(
      std::erase_if(waiting_, [&](const Rendered& rendered) { return rendered.frame.job == job; }));
  if (spool_) spool_->Remove(job->id);
  std::erase(jobs_, job);
}

void Jobs::Deliver() {
  for (const auto& job : std::vector(jobs_.begin(), jobs_.end())) Deliver(job);
}

/// Sends finished frames on, in order; lets go of a job that everyone has.
void Jobs::Deliver(const std::shared_ptr<Job>& job) {
  if (rests_) return;  // frames that clients do not get now stay in the spool
  size_t needed = job->states.size();
  for (Job::Client& client : job->clients) {
    while (client.next < job->states.size() && job->states[client.next] == Job::FrameState::kFinished &&
           client.connection->queued_bytes() < kFullQueueBytes && SendFrame(*job, client))
      ++client.next;
    needed = std::min(needed, client.next);
  }
  if (job->clients.empty()) needed = 0;
  for (size_t f = 0; f < (spool_ ? job->states.size() : needed); ++f) {
    job->finished[f].image = {};
    job->finished[f].memory.reset();
  }
  if (needed < job->states.size()) return;
  callbacks_.log(
      fmt::format("job {} is done, {:.1f} s after its request", ShortId(job->id), SecondsSince(job->asked)));
  Remove(job);
}

/// False when too much is on its way to clients; or when the image is not there any more: the frame is
/// rendered again.
bool Jobs::SendFrame(Job& job, const Job::Client& client) {
  const size_t f = client.next;
  if (!MaySend(job.finished[f].image.size())) return false;
  Bytes image = job.finished[f].image;
  if (image.empty() && spool_) {
    auto read = spool_->ReadFrame(job.id, job.job, f);
    if (read)
      image = std::move(*read);
    else
      callbacks_.log(
          fmt::format("job {}: {}; the frame is rendered again", ShortId(job.id), read.error().message));
  }
  if (image.empty()) {
    job.states[f] = Job::FrameState::kToDo;
    callbacks_.on_work();
    return false;
  }
  const uint32_t number = job.Number(f);
  std::string statistics = job.finished[f].statistics;
  if (statistics.empty())  // made by a master before this one
    statistics = fmt::format("{{\"frame\": {}, \"from_spool\": true}}", number);
  Message m = MakeMessage(MessageType::kFrameDone, FrameDone{number, std::move(statistics)});
  m.raw = std::move(image);
  client.connection->Send(std::move(m));
  return true;
}

void Jobs::DropAbandoned(double now_s) {
  if (spool_) return;
  for (const auto& job : std::vector(jobs_.begin(), jobs_.end()))
    if (job->clients.empty() && now_s - job->alone_since_s > kClientGraceS) {
      callbacks_.log(fmt::format("job {} is dropped: its client has been gone for {:.0f} s", ShortId(job->id),
                                 kClientGraceS));
      Remove(job);
    }
}

}  // namespace quarry
