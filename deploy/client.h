#pragma once

#include <functional>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"

namespace quarry {

struct RenderCallbacks {
  std::function<void(const FrameProgress&)> on_progress;
  /// A finished frame: the image file's bytes. An error ends the job.
  std::function<Status(const FrameDone&, Bytes image)> on_frame;
  /// Called a few times a second: an error ends the job (a process that it needs has died, say).
  std::function<Status()> check;
};

/// Connects as `security` says, sends `job` to the master and waits for its frames. `scene` must be the scene
/// that the master serves. Errors: out of reach, another scene, the master's own sentence, the connection
/// lost, and what the callbacks return.
Status RenderRemotely(const Endpoint& master, const Security& security, const SceneId& scene,
                      const RenderJob& job, const RenderCallbacks& callbacks);

}  // namespace quarry
