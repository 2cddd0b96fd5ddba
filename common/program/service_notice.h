#pragma once

#include <string>

namespace quarry {

/// Notifies the service manager that this program is ready, in systemd's protocol (sd_notify(3)): a datagram
/// to the socket that NOTIFY_SOCKET names. `status`: one line, which `systemctl status` shows. No effect when
/// NOTIFY_SOCKET is not set or the manager does not take the message. Never blocks.
void NotifyReady(const std::string& status);

}  // namespace quarry
