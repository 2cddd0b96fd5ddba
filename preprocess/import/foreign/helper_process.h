#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>

#include "common/base/status.h"

namespace quarry {

/// A program of Quarry's that decodes bytes of strangers, spoken to through its standard input and output. It
/// ends with this process. Requires: SIGPIPE is ignored. Thread safety: none.
class HelperProcess {
 public:
  /// Units: `memory` in bytes, that the program may take beyond its own.
  HelperProcess(std::string program, uint64_t memory) : program_(std::move(program)), memory_(memory) {}
  ~HelperProcess() { Stop(); }
  HelperProcess(const HelperProcess&) = delete;

  const std::string& program() const { return program_; }
  bool running() const { return child_ > 0; }
  /// Starts the program if it does not run. Errors: it cannot be started.
  Status Start();
  /// Kills the program, which may still work on a result that is no longer wanted.
  void Stop();
  /// Waits for the end of a program that has closed its pipes. Returns: its status, as of waitpid().
  /// Requires: running().
  int Wait();

  int to() const { return to_; }
  int from() const { return from_; }

 private:
  std::string program_;
  uint64_t memory_;
  pid_t child_ = -1;
  int to_ = -1, from_ = -1;  ///< pipes
};

}  // namespace quarry
