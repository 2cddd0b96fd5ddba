#include <fmt/format.h>

#include <utility>

#include "master/server.h"

// How a Server handles its workers' messages.

namespace quarry {

/// A set of blocks takes memory by the largest number in it.
Status Server::CheckBlocks(const std::vector<uint32_t>& blocks) const {
  if (blocks.size() > block_bytes_.size())
    return Fail(fmt::format("it names {} blocks, and the scene has {}", blocks.size(), block_bytes_.size()));
  for (const uint32_t block : blocks)
    if (block >= block_bytes_.size()) return Fail(fmt::format("there is no block {}", block));
  return {};
}

uint32_t Server::AddWorker(const ConnectionPtr& c, const Hello& hello) {
  // The same worker on a connection that is not yet known to be lost.
  if (const WorkerRecord* old = registry_.FindInstance(hello.instance)) {
    const ConnectionPtr lost = old->connection;
    Refuse(lost, "this worker has joined again on another connection");
  }
  WorkerRecord& worker = registry_.Add(c, hello);
  dispatcher_.AddWorker(worker);
  Log(fmt::format("worker {} has joined with {} threads", worker.name, worker.threads));
  if (!hello.previous_end.empty()) {
    const char* const stop = hello.previous_end.ends_with('?') ? "" : ".";
    const std::string sentence =
        fmt::format("Worker {} was {}{} It is started again.", worker.name, hello.previous_end, stop);
    Log(sentence);
    if (display_) display_->Notify(sentence);
  }
  return worker.id;
}

Status Server::OnWorkerMessage(WorkerRecord& worker, const Message& m) {
  if (m.type == MessageType::kTileDone) return OnTileDone(worker, m);
  if (m.type == MessageType::kRayDone) return OnRayDone(worker, m);
  if (m.type == MessageType::kFailure) return OnWorkerFailure(worker, m);
  if (m.type == MessageType::kWorkerStatus) return OnWorkerStatus(worker, m);
  if (m.type == MessageType::kLeave) return OnWorkerLeaves(worker, m);
  if (m.type != MessageType::kHello)
    return Fail(fmt::format("a message of type {} is not allowed here", static_cast<int>(m.type)));
  QUARRY_ASSIGN(const Hello hello, DecodeHello(m.table));
  worker.SetServesAt(hello.serves_at);
  return {};
}

Status Server::OnWorkerStatus(WorkerRecord& worker, const Message& m) {
  QUARRY_ASSIGN(const WorkerStatus status, DecodeWorkerStatus(m.table));
  QUARRY_TRY(CheckBlocks(status.cached));
  QUARRY_TRY(CheckBlocks(status.dropped));
  WorkerRegistry::Update(worker, status);
  UpdateCosts();
  if (status.whole) {  // it has the scene now, or has come back with its cache
    worker.has_scene = true;
    WorkersChanged();
  }
  return {};
}

Status Server::OnTileDone(WorkerRecord& worker, const Message& m) {
  QUARRY_ASSIGN(const TileDone done, DecodeTileDone(m.table));
  if (JobMeter::Owns(done.frame)) {
    worker.responsiveness.Answered(false);  // it works, though not on frames
    AssignSoon();
    return meter_.Take(worker.id, done, m.raw);
  }
  if (Display::Owns(done.frame)) {
    worker.responsiveness.Answered(false);  // it works, though not on jobs
    return display_ ? display_->OnTileDone(worker.id, done, m.raw) : Status{};
  }
  QUARRY_TRY(CheckBlocks(done.blocks));
  AssignSoon();
  const ActiveFrame* frame = dispatcher_.Find(done.frame);
  const uint32_t number = frame ? frames_.NumberOf(done.frame) : 0;
  QUARRY_ASSIGN(const bool kept, dispatcher_.Finish(worker, done, m.raw, Now()));
  if (kept) frames_.LogTile(number, done, worker.name);
  return {};
}

Status Server::OnRayDone(WorkerRecord& worker, const Message& m) {
  QUARRY_ASSIGN(const RayDone done, DecodeRayDone(m.table));
  worker.responsiveness.Answered(false);  // it works, though not on jobs
  if (display_) display_->OnRayDone(worker.id, done);
  return {};
}

/// The worker gets no more tiles. Results of tiles that it has begun may still arrive.
Status Server::OnWorkerLeaves(WorkerRecord& worker, const Message& m) {
  QUARRY_ASSIGN(const Leave leave, DecodeLeave(m.table));
  for (size_t i = 0; i < leave.frames.size(); ++i)
    dispatcher_.GiveBack(worker.id, leave.frames[i], leave.leases[i]);
  if (std::exchange(worker.ready, false)) {
    Log(fmt::format("worker {} leaves and returns {} tiles", worker.name, leave.leases.size()));
    meter_.RemoveWorker(worker.id);
    if (display_) display_->WorkerGone(worker.id);
    WorkersChanged();
  }
  AssignSoon();
  if (!leave.last) return {};
  const ConnectionPtr c = worker.connection;
  c->Close();
  OnGone(c, Error{"it has left"}, true);
  return {};
}

/// A worker that cannot continue sends the reason, and is dropped.
Status Server::OnWorkerFailure(const WorkerRecord& worker, const Message& m) {
  QUARRY_ASSIGN(const Failure failure, DecodeFailure(m.table));
  frames_.OnWorkerFailure(worker, failure.message, meter_.HeldBy(worker.id));
  if (display_)
    display_->WorkerFailed(fmt::format("Worker {} has given up: {}", worker.name, failure.message));
  Log(fmt::format("worker {} gives up: {}", worker.name, failure.message));
  return Fail(failure.message);
}

void Server::UpdateCosts() {
  dispatcher_.SetCosts(registry_.SecondsPerByte(decoded_per_stored_), registry_.DecodeSeconds());
}

void Server::SendPeers() {
  const Peers peers = registry_.MakePeers();
  for (auto& [id, worker] : registry_.all())
    if (worker.has_scene) worker.connection->Send(MakeMessage(MessageType::kPeers, peers));
}

}  // namespace quarry
