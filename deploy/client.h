#pragma once

#include <functional>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"

namespace quarry {

struct RenderCallbacks {
  std::function<void(const FrameProgress&)> on_progress;
  /// A finished frame: the image file's bytes. An error is tried again every second (a full disk may get
  /// space), and ends the job after RenderRemotely's `retry_s`; one of usage ends it at once.
  std::function<Status(const FrameDone&, const Bytes& image)> on_frame;
  /// Called a few times a second: an error ends the job (a process that it needs has died, say).
  std::function<Status()> check;
  /// A line for the person: the master is out of reach, say, and is tried again.
  std::function<void(const std::string&)> say;
};

/// Connects as `security` says, sends `job` to the master and waits for its frames. `scene` must be the scene
/// that the master serves. When the connection is lost it is made again, and the frames not here are asked
/// for again. Errors: out of reach at first, a side that does not fit, or another scene; all that for
/// `retry_s` after the master has been reached once; the master's own sentence, and what the callbacks
/// return.
Status RenderRemotely(const Endpoint& master, const Security& security, const SceneId& scene,
                      const RenderJob& job, const RenderCallbacks& callbacks, double retry_s);

}  // namespace quarry
