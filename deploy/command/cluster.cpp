#include "deploy/command/cluster.h"

#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/process.hpp>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
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

/// Deaths by signals, one soon after the other, after which a render gives a worker up: some 6 s.
constexpr int kMostDeaths = 5;

/// Removes the program's name from a message ("quarry-master: x.quarry: no such file"); the caller adds its
/// own.
std::string WithoutProgram(const std::string& line) {
  const size_t colon = line.find(": ");
  return line.rfind("quarry-", 0) == 0 && colon != std::string::npos ? line.substr(colon + 2) : line;
}

std::string SignalText(int signal) {
  return signal == SIGKILL ? "killed by signal 9, out of memory?"
                           : fmt::format("ended by signal {} ({})", signal, ::strsignal(signal));
}

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
  /// The reason for its end: its own last message, or the signal. Requires: !Running().
  Error Why(const std::string& name) {
    if (const std::string signal = SignalThatEnded(); !signal.empty())
      return Error{fmt::format("{} was {}", name, signal)};
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // time to read the last message
    const std::lock_guard lock(mutex_);
    const int status = child_.exit_code();
    return Error{last_error_.empty() ? fmt::format("{} ended with status {}", name, status)
                                     : WithoutProgram(last_error_),
                 status == 0 ? ErrorKind::kFailed : KindOfExit(status)};
  }
  /// "killed by signal 9, ...", or empty when no signal ended it. Requires: !Running().
  std::string SignalThatEnded() const {
    const int ended = child_.native_exit_code();
    return WIFSIGNALED(ended) ? SignalText(WTERMSIG(ended)) : std::string();
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

/// The rest of the child's next line, which begins with `word`. Errors: the child has ended; its last
/// message.
Result<std::string> ReadAnnouncement(Child& child, const std::string& word) {
  std::string line;
  if (child.ReadLine(line) && line.rfind(word + " ", 0) == 0) return line.substr(word.size() + 1);
  while (child.Running()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return tl::unexpected<Error>(child.Why("the master"));
}

/// The master's arguments for a live view.
std::vector<std::string> ArgumentsOf(const LiveViewOptions& live) {
  std::vector<std::string> arguments{"--http",        live.address,    "--view-token-file",
                                     live.token_file, "--view-memory", live.view_memory};
  for (const std::string& url : live.viewer_urls) arguments.insert(arguments.end(), {"--viewer-url", url});
  if (!live.up_axis.empty()) arguments.insert(arguments.end(), {"--up-axis", live.up_axis});
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
    return Fail(fmt::format("cannot start the page: {}", SentenceOf(e)));
  }
  return std::unique_ptr<PreparingPage>(new PreparingPage(std::move(impl)));
}

/// A worker of the cluster, which is started again when a signal ends it.
struct LocalWorker {
  using Clock = std::chrono::steady_clock;
  std::string name;
  std::vector<std::string> arguments;
  std::unique_ptr<Child> child;  ///< none while it waits to be started again
  Error why;                     ///< the reason for its last end
  std::string end;               ///< the signal that ended it last
  bool gave_up = false;          ///< not started again
  int deaths = 0;                ///< one soon after the other
  Clock::time_point started, again;

  void Start() {
    auto all = arguments;
    if (!end.empty()) all.insert(all.end(), {"--previous-end", end});
    child = std::make_unique<Child>(SiblingProgram("quarry-worker"), all);
    started = Clock::now();
  }

  /// Decides whether and when it starts again. `most_deaths`: after more deaths in a row it stays ended.
  void OnEnded(int most_deaths, const std::function<void(const std::string&)>& say) {
    // Deaths that lie further apart are no series; waits between them double up to the longest.
    constexpr auto kApart = std::chrono::seconds(60), kLongest = std::chrono::seconds(10);
    constexpr auto kFirst = std::chrono::milliseconds(200);
    why = child->Why("worker " + name);
    end = child->SignalThatEnded();
    deaths = Clock::now() - started > kApart ? 1 : deaths + 1;
    gave_up = end.empty() || deaths > most_deaths;
    child.reset();
    again = Clock::now() + std::min<Clock::duration>(kLongest, kFirst * (1 << std::min(deaths - 1, 6)));
    if (!gave_up) say(why.message + "; it is started again");
  }
};

struct LocalCluster::Impl {
  std::unique_ptr<Child> master;
  std::vector<LocalWorker> workers;
  Endpoint endpoint;
  std::string live_url;
  int most_deaths = 0;
  std::function<void(const std::string&)> say;
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
  impl->most_deaths = options.lasting ? std::numeric_limits<int>::max() : kMostDeaths;
  impl->say = options.say ? options.say : [](const std::string&) {};
  unsigned threads = options.threads;
  if (threads == 0) threads = std::max(1u, UsableProcessors() / std::max(1u, options.workers));
  std::vector<std::string> for_all{"--quiet"};
  for (const SecurityOptionName& name : SecurityOptionNames())
    if (const std::string& value = options.security.*name.field; !value.empty())
      for_all.insert(for_all.end(), {name.flag, value});
  const auto remote = Flags(options.remote);
  for_all.insert(for_all.end(), remote.begin(), remote.end());
  // Workers fetch from the server themselves. They may send tokens to a server that the command names.
  const auto source = IsRemote(options.scene) ? std::vector<std::string>{"--source", options.scene}
                                              : std::vector<std::string>{};
  const auto with = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), for_all.begin(), for_all.end());
    return arguments;
  };
  try {
    auto for_master = with({options.scene, "--listen", "127.0.0.1:0"});
    for (const std::string& environment : options.environments)
      for_master.insert(for_master.end(), {"--environment", environment});
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
      impl->workers.push_back({.name = fmt::format("local-{}", i + 1), .arguments = std::move(for_worker)});
      impl->workers.back().Start();
    }
  } catch (const std::exception& e) {
    return Fail(fmt::format("cannot start a program of the cluster: {}", SentenceOf(e)));
  }
  return std::unique_ptr<LocalCluster>(new LocalCluster(std::move(impl)));
}

Status LocalCluster::Check() {
  if (!impl_->master->Running()) return tl::unexpected<Error>(impl_->master->Why("the master"));
  try {
    for (LocalWorker& worker : impl_->workers) {
      if (worker.child && !worker.child->Running()) worker.OnEnded(impl_->most_deaths, impl_->say);
      if (!worker.child && !worker.gave_up && LocalWorker::Clock::now() >= worker.again) worker.Start();
    }
  } catch (const std::exception& e) {
    return Fail(fmt::format("cannot start a worker again: {}", e.what()));
  }
  const bool any = std::ranges::any_of(impl_->workers, [](const LocalWorker& w) { return !w.gave_up; });
  return any ? Status{} : tl::unexpected<Error>(impl_->workers.front().why);
}

void AddLocalClusterOptions(CLI::App& command, unsigned& workers, unsigned& threads, std::string& cache) {
  command.add_option("--workers", workers, "Worker processes")
      ->check(WholeNumber(1, 256))
      ->capture_default_str();
  command
      .add_option("--threads", threads,
                  "Threads per worker (default: the processors divided among the workers)")
      ->envname("QUARRY_THREADS")
      ->check(WholeNumber(1, 1024));
  command.add_option("--cache", cache, "Memory for decoded voxels, per worker")
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
