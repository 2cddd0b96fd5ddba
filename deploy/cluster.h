#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/net/connection.h"

namespace quarry {

/// A master and workers on this machine, started for one command and ended with it, however it ends.
class LocalCluster {
 public:
  struct Options {
    std::string scene;
    unsigned workers = 1;
    unsigned threads = 0;  ///< per worker; 0: the machine's processors shared out
    std::string cache = "256M";
    SecurityOptions security;  ///< as given to this command; what the environment says is for other clusters
  };
  /// Waits for the master to listen. Errors: a program cannot be started; the master's own sentence.
  static Result<std::unique_ptr<LocalCluster>> Start(const Options& options);
  ~LocalCluster();

  Endpoint master() const;
  /// An error once the master, or every worker, has ended: with the sentence that it printed.
  Status Check();

 private:
  struct Impl;
  explicit LocalCluster(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// The path of a program that lies beside this one.
std::string SiblingProgram(const std::string& name);

/// Runs a sibling program to its end, its output passed on. Returns its exit status.
Result<int> RunSibling(const std::string& name, const std::vector<std::string>& arguments);

}  // namespace quarry
