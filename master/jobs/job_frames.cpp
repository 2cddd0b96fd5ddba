#include "master/jobs/job_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>

#include "master/jobs/statistics.h"

namespace quarry {

std::optional<View> JobFrames::Begin(FrameId id, double now_s) {
  auto frame = jobs_.Begin();
  if (!frame) return std::nullopt;
  if (tile_log_) tile_log_->Frame(frame->number(), frame->view);
  failures_ = 0;
  return under_way_.emplace(id, UnderWay{std::move(*frame), now_s, bytes_served_()}).first->second.frame.view;
}

void JobFrames::Probe(std::span<ActiveFrame* const> frames) {
  if (!probe_) return;
  /// Frames probed before they begin, and tiles beyond which a frame is not probed: the time of one thread.
  constexpr size_t kAhead = 3, kMostTiles = 4096;
  std::vector<FootprintProbe::Wish> wishes;
  const auto add = [&](const JobFrame& frame) {
    const uint64_t pixels = uint64_t{frame.view.crop.width} * frame.view.crop.height;
    if (pixels <= kMostTiles * kTileSize * kTileSize)
      wishes.push_back({frame.job->id, frame.index, frame.view});
  };
  // One worker gets all tiles, whatever they touch.
  if (workers_.all().size() > 1) {
    for (const ActiveFrame* frame : frames)
      if (!frame->learned() && frame->open_tiles() > 0) add(under_way_.at(frame->id()).frame);
    for (const JobFrame& next : jobs_.Upcoming(kAhead)) add(next);
  }
  probe_->Want(std::move(wishes));
  for (ActiveFrame* frame : frames) {
    const JobFrame& of_job = under_way_.at(frame->id()).frame;
    if (frame->learned()) continue;
    if (auto coarse = probe_->Find(of_job.job->id, of_job.index)) frame->Learn(std::move(coarse));
  }
}

bool JobFrames::IsNextBeingProbed() const {
  const auto next = jobs_.Upcoming(1);
  return probe_ && !next.empty() && probe_->IsAtWork(next[0].job->id, next[0].index);
}

bool JobFrames::HasNews(std::span<ActiveFrame* const> frames) const {
  return std::ranges::any_of(frames, [this](const ActiveFrame* frame) {
    const JobFrame& of_job = under_way_.at(frame->id()).frame;
    return !frame->learned() && probe_->Find(of_job.job->id, of_job.index);
  });
}

void JobFrames::Finish(ActiveFrame& frame, double now_s) {
  UnderWay done = std::move(under_way_.extract(frame.id()).mapped());
  const FrameTimes times{done.frame.number(), done.start_s, now_s,
                         bytes_served_() - done.bytes_served_before};
  jobs_.Finish(std::move(done.frame), frame.TakePixels(), FrameStatistics(frame, times, workers_));
}

void JobFrames::OnWorkerFailure(const WorkerRecord& worker, const std::string& sentence,
                                const std::string& metered) {
  std::shared_ptr<Job> job = jobs_.AwaitsExposure(metered);
  failures_ += worker.tiles > 0 || job;
  if (!job && !under_way_.empty()) job = under_way_.begin()->second.frame.job;
  if (!worker.has_scene || !job || (failures_ < kMostFailures && workers_.all().size() > 1)) return;
  jobs_.Fail(job, fmt::format("worker {} cannot get voxels: {}; check its --source, or the master's",
                              worker.name, sentence));
}

std::vector<FrameId> JobFrames::Forget(const Job& job) {
  std::vector<FrameId> ids;
  for (const auto& [id, under_way] : under_way_)
    if (under_way.frame.job.get() == &job) ids.push_back(id);
  for (const FrameId id : ids) under_way_.erase(id);
  return ids;
}

std::map<std::string, double> JobFrames::PartsDone(std::span<ActiveFrame* const> frames) const {
  std::map<std::string, double> parts;
  for (const ActiveFrame* frame : frames)
    parts[under_way_.at(frame->id()).frame.job->id] +=
        frame->tiles_done() / static_cast<double>(std::max<size_t>(frame->image().tiles().size(), 1));
  return parts;
}

void JobFrames::SendProgress(std::span<ActiveFrame* const> frames) const {
  const auto send = [](const Job::Client& client, const FrameProgress& progress) {
    client.connection->Send(MakeMessage(MessageType::kFrameProgress, progress));
  };
  const auto workers = static_cast<uint32_t>(workers_.all().size());
  if (workers == 0)  // a client that waits learns why
    for (const auto& job : jobs_.all())
      for (const Job::Client& client : job->clients) send(client, {job->Number(client.next), 0, 0, 0});
  std::set<const Job*> notified;
  for (const ActiveFrame* frame : frames) {
    const Job* job = under_way_.at(frame->id()).frame.job.get();
    if (!notified.insert(job).second) continue;
    for (const Job::Client& client : job->clients)
      send(client, {NumberOf(frame->id()), frame->tiles_done(),
                    static_cast<uint32_t>(frame->image().tiles().size()), workers});
  }
}

}  // namespace quarry
