#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/net/connection.h"

namespace quarry {

/// A master and workers on this machine that serve a single command and end with it, however it ends. Not
/// thread-safe.
class LocalCluster {
 public:
  struct Options {
    std::string scene;
    unsigned workers = 1;
    unsigned threads = 0;        ///< per worker; 0: the machine's processors divided among the workers
    std::string cache = "256M";  ///< each worker's cache, as ParseSize() reads it
    SecurityOptions security;    ///< this command's options only: the environment's belong to other clusters
  };
  /// Starts the programs and waits until the master listens. Errors: a program cannot be started; the
  /// master's own message.
  static Result<std::unique_ptr<LocalCluster>> Start(const Options& options);
  /// Ends all programs (SIGTERM) and waits for them.
  ~LocalCluster();

  /// The address that the master listens at.
  Endpoint master() const;
  /// Errors: the master, or every worker, has ended; the message is the program's last.
  Status Check();

 private:
  struct Impl;
  explicit LocalCluster(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// The path of a program in the folder of this program.
std::string SiblingProgram(const std::string& name);

/// Runs a sibling program to its end and passes its output on. Returns: its exit status. Errors: it cannot be
/// run.
Result<int> RunSibling(const std::string& name, const std::vector<std::string>& arguments);

}  // namespace quarry
