#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/command_line/remote_options.h"
#include "common/net/connection.h"

namespace CLI {
class App;
}

namespace quarry {

/// The live view of a local cluster's master.
struct LiveViewOptions {
  std::string address;                   ///< HOST:PORT
  std::vector<std::string> viewer_urls;  ///< that browsers use through a proxy
  std::string token_file;
  std::string view_memory = "256M";  ///< as ParseSize() reads it
  std::string tls_cert, tls_key;     ///< PEM files toward browsers; empty: no TLS
  std::string up_axis;               ///< "y" or "z"; empty: the scene's
};

/// A page that says how far the making of a scene is, served by a master until this is destroyed. Not
/// thread-safe.
class PreparingPage {
 public:
  /// `progress_file`: the file to which the maker of the scene writes. Errors: as LocalCluster::Start().
  static Result<std::unique_ptr<PreparingPage>> Start(const std::string& scene,
                                                      const LiveViewOptions& options,
                                                      const std::string& progress_file);
  ~PreparingPage();
  /// The address for a browser.
  const std::string& url() const;

 private:
  struct Impl;
  explicit PreparingPage(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// A master and workers on this machine that serve a single command and end with it, however it ends. Not
/// thread-safe.
class LocalCluster {
 public:
  struct Options {
    std::string scene;
    std::vector<std::string> environments = {};  ///< stores
    unsigned workers = 1;
    unsigned threads = 0;        ///< per worker; 0: the machine's processors divided among the workers
    std::string cache = "256M";  ///< each worker's cache, as ParseSize() reads it
    SecurityOptions security;    ///< this command's options only: the environment's belong to other clusters
    RemoteArguments remote;      ///< of a scene on a server
    std::optional<LiveViewOptions> live;
    bool lasting = false;  ///< workers that signals end are started again for ever, not some times
    std::function<void(const std::string&)> say = {};  ///< takes a line for the user; may be empty
  };
  /// Starts the programs and waits until the master listens. Errors: a program cannot be started; the
  /// master's own message.
  static Result<std::unique_ptr<LocalCluster>> Start(const Options& options);
  /// Ends all programs (SIGTERM) and waits for them.
  ~LocalCluster();

  /// The address that the master listens at.
  Endpoint master() const;
  /// The live view's address for a browser; empty without one.
  const std::string& live_url() const;
  /// Starts workers again that a signal has ended (the system's, when memory runs out), and says so.
  /// Errors: the master, or every worker, has ended for good; the message is the program's last.
  Status Check();

 private:
  struct Impl;
  explicit LocalCluster(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Adds --workers, --threads and --cache of a LocalCluster to a command.
void AddLocalClusterOptions(CLI::App& command, unsigned& workers, unsigned& threads, std::string& cache);

/// The path of another of Quarry's programs; where it is missing, the path where it is missed.
std::string SiblingProgram(const std::string& name);

/// Runs a sibling program to its end and passes its output on. Returns: its exit status. Errors: it cannot be
/// run.
Result<int> RunSibling(const std::string& name, const std::vector<std::string>& arguments);

}  // namespace quarry
