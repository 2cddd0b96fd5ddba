#pragma once

#include <string>

#include "common/base/status.h"

namespace quarry {

/// The file with the token of a store's live view at an address, made if there is none. With the same token a
/// view that is started again lets its pages in again. It lies in $XDG_STATE_HOME/quarry/tokens, else
/// ~/.local/state/quarry/tokens: a folder of mode 0700, files of mode 0600. Removing them makes new tokens.
/// `address`: HOST:PORT.
/// Errors: there is no such folder, and none can be made; it, or the file, is another's or open to others.
Result<std::string> KeptTokenFile(const std::string& scene, const std::string& address);

/// Writes a new token to a new file that nobody else may read. Errors: the file is there, or cannot be
/// written.
Status WriteNewToken(const std::string& path);

}  // namespace quarry
