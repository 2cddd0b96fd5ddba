#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// The output of a command, and its exit status.
struct CommandOutput {
  int status = 0;
  std::string out, err;

  /// The last line of `err` that says something.
  std::string LastError() const;
};

/// Runs a command of the PATH to its end. Errors: it is not there, or cannot be run.
Result<CommandOutput> OutputOf(const std::string& name, const std::vector<std::string>& arguments);

}  // namespace quarry
