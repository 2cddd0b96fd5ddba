#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <new>
#include <utility>

namespace quarry {

/// Takes a function and runs it later on a certain thread, in the order of the calls. Thread-safe.
using Executor = std::function<void(std::function<void()>)>;

/// A queue of functions for one or several threads to run. Thread-safe.
class TaskQueue {
 public:
  /// `on_no_memory`: called on the thread of a task that throws std::bad_alloc, which is lost; it must not
  /// allocate. Null: the exception goes on.
  explicit TaskQueue(std::function<void()> on_no_memory = {}) : on_no_memory_(std::move(on_no_memory)) {}

  void Post(std::function<void()> task) {
    {
      const std::lock_guard lock(mutex_);
      tasks_.push_back(std::move(task));
    }
    changed_.notify_one();
  }
  /// Runs tasks on the calling thread until Stop(); tasks not begun by then are dropped.
  void Run() {
    for (std::unique_lock lock(mutex_);;) {
      changed_.wait(lock, [this] { return stopped_ || !tasks_.empty(); });
      if (stopped_) return;
      const std::function<void()> task = std::move(tasks_.front());
      tasks_.pop_front();
      lock.unlock();
      Do(task);
      lock.lock();
    }
  }
  /// Makes every Run() return after its present task.
  void Stop() {
    {
      const std::lock_guard lock(mutex_);
      stopped_ = true;
    }
    changed_.notify_all();
  }

 private:
  void Do(const std::function<void()>& task) const {
    try {
      task();
    } catch (const std::bad_alloc&) {
      if (!on_no_memory_) throw;
      on_no_memory_();
    }
  }

  const std::function<void()> on_no_memory_;
  std::mutex mutex_;  ///< guards all below
  std::condition_variable changed_;
  std::deque<std::function<void()>> tasks_;
  bool stopped_ = false;
};

}  // namespace quarry
