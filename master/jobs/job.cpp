#include "master/jobs/job.h"

#include <algorithm>

namespace quarry {

bool Job::Complete() const {
  return std::all_of(states.begin(), states.end(), [](FrameState s) { return s == FrameState::kFinished; });
}

size_t Job::NextToDo() const {
  return static_cast<size_t>(std::find(states.begin(), states.end(), FrameState::kToDo) - states.begin());
}

}  // namespace quarry
