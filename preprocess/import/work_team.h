#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace quarry {

/// Threads that help others with loops. They start with the first loop that has work for two, and end with
/// the team. Thread safety: ForEach() from several threads at once, which share the helpers.
class WorkTeam {
 public:
  /// Without helpers, callers do all work themselves.
  explicit WorkTeam(unsigned helpers) : wanted_(helpers) {}
  ~WorkTeam();
  WorkTeam(const WorkTeam&) = delete;
  /// Threads that work on a loop, at most: the caller's and the helpers.
  size_t threads() const { return wanted_ + size_t{1}; }

  /// Calls work(0) to work(count - 1), on this thread and the helpers that are free, in any order, and
  /// returns when all calls have ended. Requires: `work` calls no ForEach(). An exception of `work` reaches
  /// the caller; calls that have not begun by then are left out.
  void ForEach(size_t count, const std::function<void(size_t)>& work);

 private:
  struct Loop;
  void Start();
  void Help();
  void DoPart(Loop& loop, std::unique_lock<std::mutex>& lock);

  const unsigned wanted_;
  std::mutex mutex_;
  std::condition_variable has_work_, has_ended_;
  std::vector<Loop*> loops_;  ///< with calls that have not begun
  bool ends_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace quarry
