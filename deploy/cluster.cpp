#include "deploy/cluster.h"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/process.hpp>
#include <filesystem>
#include <mutex>
#include <thread>
#include <utility>

#include "common/base/number.h"
#include "common/base/resource.h"
#include "common/program/installed_program.h"
#include "common/remote/open_store.h"

namespace quarry {
namespace {

namespace bp = boost::process;

/// A child process, and a thread that reads its standard error and keeps the last line.
class Child {
 public:
  Child(const std::string& program, const std::vector<std::string>& arguments)
      : environment_(boost::this_process::environment()) {
    environment_["QUARRY_PARENT"] = std::to_string(::getpid());
    for (const SecurityOptionName& name : SecurityOptionNames()) environment_.erase(name.variable);
    child_ = bp::child(program, bp::args(arguments), bp::std_out > out_, bp::std_err > err_,
                       bp::std_in < bp::null, environment_);
    reader_ = std::thread([this] { ReadErrors(); });
  }
  ~Child() {
    std::error_code ignored;
    if (child_.running(ignored)) ::kill(child_.id(), SIGTERM);
    child_.wait(ignored);
    reader_.join();
  }
  bool Running() {
    std::error_code ignored;
    return child_.running(ignored);
  }
  bool ReadLine(std::string& line) { return static_cast<bool>(std::getline(out_, line)); }
  int exit_status() const { return child_.exit_code(); }
  std::string last_error() {
    const std::lock_guard lock(mutex_);
    return last_error_;
  }

 private:
  void ReadErrors() {
    std::string line;
    while (std::getline(err_, line)) {
      const std::lock_guard lock(mutex_);
      if (!line.empty()) last_error_ = line;
    }
  }
  bp::environment environment_;
  bp::ipstream out_, err_;
  bp::child child_;
  std::thread reader_;
  std::mutex mutex_;
  std::string last_error_;
};

/// Removes the program's name from a message ("quarry-master: x.quarry: no such file"); the caller adds its
/// own.
std::string WithoutProgram(const std::string& line) {
  const size_t colon = line.find(": ");
  return line.rfind("quarry-", 0) == 0 && colon != std::string::npos ? line.substr(colon + 2) : line;
}

/// The rest of the child's next line, which begins with `word`. Errors: the child has ended; its last
/// message.
Result<std::string> ReadAnnouncement(Child& child, const std::string& word) {
  std::string line;
  if (child.ReadLine(line) && line.rfind(word + " ", 0) == 0) return line.substr(word.size() + 1);
  while (child.Running()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  return tl::unexpected<Error>(Error{WithoutProgram(child.last_error()), KindOfExit(child.exit_status())});
}

/// The master's arguments for a live view.
std::vector<std::string> ArgumentsOf(const LiveViewOptions& live) {
  std::vector<std::string> arguments{"--http",        live.address,    "--view-token-file",
                                     live.token_file, "--view-memory", live.view_memory};
  for (const std::string& url : live.viewer_urls) arguments.insert(arguments.end(), {"--viewer-url", url});
  if (!live.tls_cert.empty()) arguments.insert(arguments.end(), {"--tls-cert", live.tls_cert});
  if (!live.tls_key.empty()) arguments.insert(arguments.end(), {"--tls-key", live.tls_key});
  return arguments;
}

}  // namespace

struct PreparingPage::Impl {
  std::unique_ptr<Child> master;
  std::string url;
};

PreparingPage::PreparingPage(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PreparingPage::~PreparingPage() = default;
const std::string& PreparingPage::url() const { return impl_->url; }

Result<std::unique_ptr<PreparingPage>> PreparingPage::Start(const std::string& scene,
                                                            const LiveViewOptions& options,
                                                            const std::string& progress_file) {
  auto impl = std::make_unique<Impl>();
  std::vector<std::string> arguments{scene, "--preparing", progress_file, "--quiet"};
  const auto live = ArgumentsOf(options);
  arguments.insert(arguments.end(), live.begin(), live.end());
  try {
    impl->master = std::make_unique<Child>(SiblingProgram("quarry-master"), arguments);
    QUARRY_ASSIGN(impl->url, ReadAnnouncement(*impl->master, "viewing"));
  } catch (const std::exception& e) {
    return Fail(fmt::format("cannot start the page: {}", e.what()));
  }
  return std::unique_ptr<PreparingPage>(new PreparingPage(std::move(impl)));
}

struct LocalCluster::Impl {
  std::unique_ptr<Child> master;
  std::vector<std::unique_ptr<Child>> workers;
  Endpoint endpoint;
  std::string live_url;
};

LocalCluster::LocalCluster(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
LocalCluster::~LocalCluster() {
  impl_->workers.clear();
  impl_->master.reset();
}
Endpoint LocalCluster::master() const { return impl_->endpoint; }
const std::string& LocalCluster::live_url() const { return impl_->live_url; }

Result<std::unique_ptr<LocalCluster>> LocalCluster::Start(const Options& options) {
  auto impl = std::make_unique<Impl>();
  unsigned threads = options.threads;
  if (threads == 0) threads = std::max(1u, UsableProcessors() / std::max(1u, options.workers));
  std::vector<std::string> for_all{"--quiet"};
  for (const SecurityOptionName& name : SecurityOptionNames())
    if (const std::string& value = options.security.*name.field; !value.empty())
      for_all.insert(for_all.end(), {name.flag, value});
  const auto remote = Flags(options.remote);
  for_all.insert(for_all.end(), remote.begin(), remote.end());
  // Workers fetch from the server themselves. What the command names they may send tokens to.
  const auto source = IsRemote(options.scene) ? std::vector<std::string>{"--source", options.scene}
                                              : std::vector<std::string>{};
  const auto with = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), for_all.begin(), for_all.end());
    return arguments;
  };
  try {
    auto for_master = with({options.scene, "--listen", "127.0.0.1:0"});
    if (options.live) {
      const auto live = ArgumentsOf(*options.live);
      for_master.insert(for_master.end(), live.begin(), live.end());
    }
    impl->master = std::make_unique<Child>(SiblingProgram("quarry-master"), for_master);
    if (options.live) {
      QUARRY_ASSIGN(impl->live_url, ReadAnnouncement(*impl->master, "viewing"));
    }
    QUARRY_ASSIGN(const std::string address, ReadAnnouncement(*impl->master, "listening"));
    QUARRY_ASSIGN(impl->endpoint, ParseEndpoint(address, "the master's address"));
    for (unsigned i = 0; i < options.workers; ++i) {
      auto for_worker =
          with({"--master", address, "--cache", options.cache, "--threads", std::to_string(threads), "--name",
                fmt::format("local-{}", i + 1), "--peers", "off"});
      for_worker.insert(for_worker.end(), source.begin(), source.end());
      impl->workers.push_back(std::make_unique<Child>(SiblingProgram("quarry-worker"), for_worker));
    }
  } catch (const std::exception& e) {
    return Fail(fmt::format("cannot start a program of the cluster: {}", e.what()));
  }
  return std::unique_ptr<LocalCluster>(new LocalCluster(std::move(impl)));
}

Status LocalCluster::Check() {
  const auto ended = [](Child& child) {
    return tl::unexpected<Error>(Error{WithoutProgram(child.last_error()), KindOfExit(child.exit_status())});
  };
  if (!impl_->master->Running()) return ended(*impl_->master);
  for (auto& worker : impl_->workers)
    if (worker->Running()) return {};
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // time to read the last messages
  for (auto& worker : impl_->workers)
    if (!worker->last_error().empty()) return ended(*worker);
  return Fail("every worker has ended");
}

void AddLocalClusterOptions(CLI::App& command, unsigned& workers, unsigned& threads, std::string& cache) {
  command.add_option("--workers", workers, "Worker processes")
      ->check(WholeNumber(1, 256))
      ->capture_default_str();
  command.add_option("--threads", threads, "Threads per worker (default: the processors shared out)")
      ->envname("QUARRY_THREADS")
      ->check(WholeNumber(1, 1024));
  command.add_option("--cache", cache, "Decoded voxels held per worker")
      ->envname("QUARRY_CACHE")
      ->capture_default_str();
}

std::string SiblingProgram(const std::string& name) {
  const std::string found = FindProgram(name);
  return found.empty() ? (ProgramFolders().front() / name).string() : found;
}

Result<int> RunSibling(const std::string& name, const std::vector<std::string>& arguments) {
  try {
    bp::environment environment = boost::this_process::environment();
    environment["QUARRY_PARENT"] = std::to_string(::getpid());
    return bp::system(SiblingProgram(name), bp::args(arguments), environment);
  } catch (const std::exception& e) {
    return Fail(fmt::format("cannot run {}: {}", name, e.what()));
  }
}

}  // namespace quarry
