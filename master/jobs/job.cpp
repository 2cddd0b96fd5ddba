#include "master/jobs/job.h"

#include <algorithm>

namespace quarry {

bool Job::Complete() const {
  return std::all_of(states.begin(), states.end(), [](FrameState s) { return s == FrameState::kFinished; });
}

size_t Job::NextToDo() const {
  return static_cast<size_t>(std::find(states.begin(), states.end(), FrameState::kToDo) - states.begin());
}

RenderJob Job::FrameJob(size_t index) const {
  RenderJob frame_job = without_cameras;
  frame_job.cameras = {job.cameras[index]};
  frame_job.first_frame = job.first_frame + static_cast<uint32_t>(index);
  return frame_job;
}

}  // namespace quarry
