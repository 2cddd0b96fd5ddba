#pragma once

#include <string>

#include "common/base/status.h"

namespace quarry {

/// Reads the whole of a file that holds a secret. Errors (usage): cannot be read; not a regular file; others
/// may read it; another user owns it (StrangerOwns()); longer than 64 KiB.
Result<std::string> ReadSecretFile(const std::string& path);

/// Reads the whole of a small file. Errors (usage): cannot be read; not a regular file; longer than 64 KiB.
Result<std::string> ReadPlainFile(const std::string& path);

/// Checks that a file of authorities can be read without waiting: a FIFO would block its reader.
/// Errors (usage): cannot be opened; not a regular file.
Status CheckRegular(const std::string& path);

}  // namespace quarry
