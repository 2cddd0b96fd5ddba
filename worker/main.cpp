#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <thread>

#include "common/base/cleanup.h"
#include "common/base/cpu_check.h"
#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/base/version.h"
#include "common/kdtree/kernels.h"
#include "common/net/security_options.h"
#include "worker/session.h"

namespace quarry {
namespace {

Status Run(WorkerOptions options, const SecurityOptions& security, const std::string& master,
           const std::string& cache) {
  if (Kernels().empty())
    return BadUsage("QUARRY_ISA names no instruction set that this processor has: scalar, avx2 or avx512");
  QUARRY_ASSIGN(options.master, ParseEndpoint(master, "--master"));
  QUARRY_ASSIGN(options.security, Security::ForClient(WithEnvironment(security)));
  if (auto serving = Security::ForServer(WithEnvironment(security)))
    options.serving = std::move(*serving);
  else if (options.peers == "auto")
    options.peers = "off";
  else if (options.peers != "off")
    return tl::unexpected<Error>(serving.error());
  QUARRY_ASSIGN(options.cache_bytes, ParseSize(cache, "--cache"));
  return RunWorker(options);
}

int Main(int argc, char** argv) {
  RequireCpu();
  KeepHeapSmall();
  EndWithParent();
  InstallSignalHandlers("quarry-worker", "its tiles go to other workers");
  WorkerOptions options;
  SecurityOptions security;
  options.threads = std::max(1u, std::thread::hardware_concurrency());
  options.name = fmt::format("worker-{}", ::getpid());
  std::string master, cache = "256M";
  CLI::App app{"Renders tiles for a master, fetching voxels on demand into a cache of fixed size."};
  app.footer(
      "Example:\n  quarry-worker --master 127.0.0.1:9000 --cache 512M --threads 4\n"
      "QUARRY_ISA=scalar|avx2|avx512 in the environment narrows the instruction sets used; pixels are the "
      "same.");
  app.set_version_flag("--version", std::string("quarry-worker ") + kVersion);
  app.add_option("--master", master, "The master's HOST:PORT")->required()->envname("QUARRY_MASTER");
  app.add_option("--cache", cache, "Most bytes of decoded voxels held")
      ->envname("QUARRY_CACHE")
      ->capture_default_str();
  app.add_option("--threads", options.threads, "Compute threads")
      ->envname("QUARRY_THREADS")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--name", options.name, "Name in the master's log and statistics");
  app.add_option("--source", options.sources,
                 "Where voxels come from, instead of what the master says; several share the load: master, "
                 "HOST:PORT, "
                 "file:PATH")
      ->envname("QUARRY_SOURCE");
  app.add_option(
         "--peers", options.peers,
         "Serve voxels to other workers at HOST:PORT; auto: at the address that reaches the master; off")
      ->capture_default_str();
  app.add_option("--retry", options.retry_s,
                 "Seconds for which a master or a voxel out of reach is tried again")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  AddSecurityOptions(app, security);
  app.add_flag("--quiet", options.quiet, "Print errors only");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  const Status status = Run(options, security, master, cache);
  if (status) return 0;
  fmt::print(stderr, "quarry-worker: {}\n", status.error().message);
  return status.error().exit_status;
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) { return quarry::Main(argc, argv); }
