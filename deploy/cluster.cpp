#include "deploy/cluster.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/process.hpp>
#include <filesystem>
#include <mutex>
#include <thread>
#include <utility>

#include "common/base/resource.h"

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

}  // namespace

struct LocalCluster::Impl {
  std::unique_ptr<Child> master;
  std::vector<std::unique_ptr<Child>> workers;
  Endpoint endpoint;
};

LocalCluster::LocalCluster(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
LocalCluster::~LocalCluster() {
  impl_->workers.clear();
  impl_->master.reset();
}
Endpoint LocalCluster::master() const { return impl_->endpoint; }

Result<std::unique_ptr<LocalCluster>> LocalCluster::Start(const Options& options) {
  auto impl = std::make_unique<Impl>();
  unsigned threads = options.threads;
  if (threads == 0) threads = std::max(1u, UsableProcessors() / std::max(1u, options.workers));
  std::vector<std::string> for_all{"--quiet"};
  for (const SecurityOptionName& name : SecurityOptionNames())
    if (const std::string& value = options.security.*name.field; !value.empty())
      for_all.insert(for_all.end(), {name.flag, value});
  const auto with = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), for_all.begin(), for_all.end());
    return arguments;
  };
  try {
    impl->master = std::make_unique<Child>(SiblingProgram("quarry-master"),
                                           with({options.scene, "--listen", "127.0.0.1:0"}));
    std::string line;
    if (!impl->master->ReadLine(line) || line.rfind("listening ", 0) != 0) {
      while (impl->master->Running()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      return tl::unexpected<Error>(
          Error{WithoutProgram(impl->master->last_error()), KindOfExit(impl->master->exit_status())});
    }
    QUARRY_ASSIGN(impl->endpoint, ParseEndpoint(line.substr(10), "the master's address"));
    for (unsigned i = 0; i < options.workers; ++i)
      impl->workers.push_back(std::make_unique<Child>(
          SiblingProgram("quarry-worker"),
          with({"--master", line.substr(10), "--cache", options.cache, "--threads", std::to_string(threads),
                "--name", fmt::format("local-{}", i + 1), "--peers", "off"})));
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

std::string SiblingProgram(const std::string& name) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  return (self.parent_path() / name).string();
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
