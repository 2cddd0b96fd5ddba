#include "preprocess/spill/spill_writer.h"

#include <utility>

namespace quarry {

SpillWriter::~SpillWriter() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

Status SpillWriter::Give(SpillBlock& block, Write write) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return waiting_ < kMostWaiting; });
  waiting_ += block.size;
  jobs_.push_back({std::exchange(block, {}), std::move(write)});
  if (!spare_.empty()) {
    block = std::move(spare_.back());
    spare_.pop_back();
    spare_bytes_ -= block.room;
    block.size = 0;
  }
  Status status = status_;
  lock.unlock();
  changed_.notify_all();
  return status;
}

Status SpillWriter::Wait() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return jobs_.empty() && !busy_; });
  return status_;
}

void SpillWriter::Run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [&] { return !jobs_.empty() || ends_; });
    if (jobs_.empty()) return;
    Job job = std::move(jobs_.front());
    jobs_.pop_front();
    busy_ = true;
    const bool failed = !status_;
    lock.unlock();
    Status written = failed ? Status{} : job.write(job.block.content());
    lock.lock();
    if (!written) status_ = std::move(written);
    waiting_ -= job.block.size;
    if (spare_bytes_ + job.block.room <= kMostWaiting) {
      spare_bytes_ += job.block.room;
      spare_.push_back(std::move(job.block));
    }
    busy_ = false;
    changed_.notify_all();
  }
}

}  // namespace quarry
