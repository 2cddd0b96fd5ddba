#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "common/base/cleanup.h"
#include "common/base/cpu_check.h"
#include "common/base/output_path.h"
#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/base/version.h"
#include "common/command_line/command_line.h"
#include "common/command_line/security_options.h"
#include "master/server.h"

namespace quarry {
namespace {

/// What is written, decided before any work.
Status CheckOutputs(const MasterOptions& options, const SecurityOptions& security) {
  OutputGuard guard(OutputGuard::Force::kNotOffered);
  for (const std::string* file :
       {&options.scene, &security.secret_file, &security.tls_cert, &security.tls_key, &security.tls_ca})
    guard.AddInput(*file);
  if (!options.spool.empty()) QUARRY_TRY(OutputGuard::TakeFolder(options.spool));
  return options.trace.empty() ? Status{} : guard.Take(options.trace, kTraceOutput).map([](auto&&) {});
}

Status Run(MasterOptions options, const SecurityOptions& security, const std::string& listen,
           const std::string& schedule, const std::string& foresight, const std::string& frame_memory) {
  QUARRY_ASSIGN(options.listen, ParseEndpoint(listen, "--listen"));
  QUARRY_ASSIGN(options.policy, ParsePolicy(schedule));
  QUARRY_ASSIGN(options.foresight_bytes, ParseSize(foresight, "--foresight"));
  QUARRY_ASSIGN(options.frame_memory, ParseSize(frame_memory, "--frame-memory"));
  QUARRY_ASSIGN(options.security, Security::ForServer(WithEnvironment(security)));
  QUARRY_TRY(CheckOutputs(options, WithEnvironment(security)));
  return RunMaster(options);
}

int Main(int argc, char** argv) {
  RequireCpu();
  KeepHeapSmall();
  RaiseDescriptorLimit();
  EndWithParent();
  InstallSignalHandlers("quarry-master", "finished frames are with whoever asked for them");
  MasterOptions options;
  SecurityOptions security;
  std::string listen = "127.0.0.1:9000", schedule = "footprint", foresight = "256M";
  std::string frame_memory = std::to_string(MemoryLimitBytes() / 2);
  CLI::App app{"Serves a scene's voxels, hands out tiles to workers and puts frames together.",
               "quarry-master"};
  app.footer(
      "Examples:\n  quarry-master plant.quarry --listen 127.0.0.1:9000\n"
      "  quarry-master plant.quarry --listen 127.0.0.1:0 --serve-only\n"
      "  quarry-master plant.quarry --source 127.0.0.1:9001 --source 127.0.0.1:9002 --spool jobs\n"
      "  quarry-master plant.quarry --listen 0.0.0.0:9000 --secret-file quarry.secret");
  app.set_version_flag("--version", std::string("quarry-master ") + kVersion);
  app.add_option("scene", options.scene, "The scene store")->required();
  app.add_option("--listen", listen,
                 "HOST:PORT (port 0 takes a free one; beyond loopback only with a secret or certificates)")
      ->envname("QUARRY_LISTEN")
      ->capture_default_str();
  app.add_flag("--serve-only", options.serve_only, "Serve voxels and nothing else");
  app.add_option("--source", options.sources,
                 "Where workers get voxels; several share the load: master, HOST:PORT of one with "
                 "--serve-only, file:PATH")
      ->envname("QUARRY_SOURCE");
  app.add_option("--schedule", schedule, "Which worker gets which tile: footprint, last-owner or random")
      ->capture_default_str();
  app.add_option("--foresight", foresight,
                 "Memory for voxels with which to foresee, by coarse rays, what tiles will need; 0: none")
      ->capture_default_str();
  app.add_option("--frame-memory", frame_memory,
                 "Memory for pictures being made, with all that they take until their clients have them, and "
                 "for the jobs; who asks for more is refused (default: half of this machine's, or of its "
                 "cgroup's limit)")
      ->envname("QUARRY_FRAME_MEMORY");
  app.add_option("--spool", options.spool,
                 "Keep jobs and finished frames in this folder: started again, the master goes on with them");
  app.add_option("--trace", options.trace,
                 "Write what each tile touched and cost to this file, a JSON object a line");
  AddSecurityOptions(app, security);
  app.add_flag("--quiet", options.quiet, "Print errors only");
  constexpr NoEffect kNoEffect[] = {{"--schedule", "--serve-only"},     {"--foresight", "--serve-only"},
                                    {"--frame-memory", "--serve-only"}, {"--spool", "--serve-only"},
                                    {"--trace", "--serve-only"},        {"--source", "--serve-only"}};
  RefuseWithoutEffect(app, kNoEffect);
  if (const auto ended = ParseCommandLine(app, argc, argv)) return *ended;
  const Status status = Run(options, security, listen, schedule, foresight, frame_memory);
  if (status) return 0;
  fmt::print(stderr, "quarry-master: {}\n", status.error().message);
  return status.error().exit_status();
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) { return quarry::Main(argc, argv); }
