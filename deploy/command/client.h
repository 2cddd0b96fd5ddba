#pragma once

#include <functional>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"

namespace quarry {

/// The callbacks of RenderRemotely(), called on its thread. Requires: none but `check` is empty.
struct RenderCallbacks {
  std::function<void(const FrameProgress&)> on_progress;
  /// Takes the finished frames in order, each with the bytes of its image file. An error is retried every
  /// second, since a full disk may get space, and ends the job after `retry_s`; an error of usage ends it at
  /// once.
  std::function<Status(const FrameDone&, const Bytes& image)> on_frame;
  /// Called several times a second. An error ends the job, for example when a needed process has died. Empty:
  /// the job needs no process of this command's.
  std::function<Status()> check;
  /// Takes a line for the user, for example that the master is out of reach and is tried again.
  std::function<void(const std::string&)> say;
};

/// Sends `job` to the master and waits for its frames. After a loss of the connection it connects again and
/// requests the missing frames again.
/// Units: `retry_s` in seconds.
/// Requires: `scene` is the scene that the master serves.
/// Errors: at the first connection, at once: out of reach, mismatched security or version, another scene.
/// Later the same errors, after retries for `retry_s`. Also: the master's own message; errors of the
/// callbacks.
Status RenderRemotely(const Endpoint& master, const Security& security, const SceneId& scene,
                      const RenderJob& job, const RenderCallbacks& callbacks, double retry_s);

}  // namespace quarry
