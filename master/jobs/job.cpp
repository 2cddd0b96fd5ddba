#include "master/jobs/job.h"

#include <algorithm>

namespace quarry {

bool Job::Complete() const {
  return std::all_of(states.begin(), states.end(), [](FrameState s) { return s == FrameState::kFinished; });
}

size_t Job::NextToDo() const {
  return static_cast<size_t>(std::find(states.begin(), states.end(), FrameState::kToDo) - states.begin());
}

RenderJob Job::One(size_t index) const {
  RenderJob one = frame;
  one.cameras = {job.cameras[index]};
  one.first_frame = job.first_frame + static_cast<uint32_t>(index);
  return one;
}

}  // namespace quarry
