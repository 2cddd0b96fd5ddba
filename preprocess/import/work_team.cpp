#include "preprocess/import/work_team.h"

#include <algorithm>
#include <exception>
#include <utility>

namespace quarry {

/// A call of ForEach(), on its caller's stack.
struct WorkTeam::Loop {
  const std::function<void(size_t)>& work;
  size_t next, count, running;
  std::exception_ptr failure;
};

WorkTeam::~WorkTeam() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  has_work_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void WorkTeam::ForEach(size_t count, const std::function<void(size_t)>& work) {
  if (wanted_ == 0 || count < 2) {
    for (size_t i = 0; i < count; ++i) work(i);
    return;
  }
  Loop loop{work, 0, count, 0, {}};
  std::unique_lock lock(mutex_);
  Start();
  loops_.push_back(&loop);
  has_work_.notify_all();
  while (loop.next < loop.count) DoPart(loop, lock);
  has_ended_.wait(lock, [&] { return loop.running == 0; });
  if (loop.failure) std::rethrow_exception(loop.failure);
}

/// Starts the helpers that are missing. A helper that cannot be started is done without.
void WorkTeam::Start() {
  try {
    while (threads_.size() < wanted_) threads_.emplace_back([this] { Help(); });
  } catch (const std::exception&) {
  }
}

void WorkTeam::Help() {
  std::unique_lock lock(mutex_);
  while (true) {
    has_work_.wait(lock, [&] { return ends_ || !loops_.empty(); });
    if (ends_) return;
    DoPart(*loops_.front(), lock);
  }
}

/// Makes one call of the loop, without the lock. Requires: one has not begun.
void WorkTeam::DoPart(Loop& loop, std::unique_lock<std::mutex>& lock) {
  const size_t i = loop.next++;
  if (loop.next == loop.count) std::erase(loops_, &loop);
  ++loop.running;
  lock.unlock();
  std::exception_ptr failure;
  try {
    loop.work(i);
  } catch (...) {
    failure = std::current_exception();
  }
  lock.lock();
  --loop.running;
  if (failure) {
    loop.failure = failure;
    if (std::exchange(loop.next, loop.count) < loop.count) std::erase(loops_, &loop);
  }
  if (loop.running == 0) has_ended_.notify_all();
}

}  // namespace quarry
