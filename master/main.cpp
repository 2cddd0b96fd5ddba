#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>

#include "common/base/cleanup.h"
#include "common/base/log.h"
#include "common/base/output_path.h"
#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/command_line/command_line.h"
#include "common/command_line/remote_options.h"
#include "common/command_line/security_options.h"
#include "common/kdtree/instruction_sets.h"
#include "common/program/run_program.h"
#include "common/program/version_text.h"
#include "common/remote/open_store.h"
#include "master/display/preparing.h"
#include "master/server.h"

namespace quarry {
namespace {

/// Checks the files that are to be written, before any work.
Status CheckOutputs(const MasterOptions& options, const SecurityOptions& security,
                    const std::string& token_file) {
  OutputGuard guard(OutputGuard::Force::kNotOffered);
  for (const std::string& environment : options.environments) guard.AddInput(environment);
  for (const std::string* file : {&options.scene, &security.secret_file, &security.tls_cert,
                                  &security.tls_key, &security.tls_ca, &token_file})
    guard.AddInput(*file);
  if (!options.spool.empty()) QUARRY_TRY(OutputGuard::TakeFolder(options.spool));
  return options.trace.empty() ? Status{} : guard.Take(options.trace, kTraceOutput).map([](auto&&) {});
}

/// Options of the live view, as text.
struct DisplayArguments {
  std::string http, token_file, preparing, view_memory = "256M", up_axis;
  std::vector<std::string> viewer_urls;
};

/// The token in the file's first line; empty: no file was given.
Result<std::string> ReadToken(const std::string& path) {
  if (path.empty()) return std::string();
  QUARRY_ASSIGN(const Bytes secret, ReadSecret(path));
  return std::string(AsText(secret));
}

/// The scene's place, as a command can name it from any folder. Cuts off the text behind "?" in an address:
/// it may be a signature, which viewers do not get.
std::string StoreForPeople(const std::string& scene) {
  if (IsRemote(scene)) return scene.substr(0, scene.find('?'));
  std::error_code error;
  const auto absolute = std::filesystem::absolute(scene, error).lexically_normal();
  return error ? scene : absolute.string();
}

/// The display's options. Browsers get the certificate of --tls-cert; with a secret besides, Quarry's own
/// programs use the secret, and without an authority for their certificates nothing.
Result<std::optional<DisplayOptions>> DisplayOf(const DisplayArguments& a, const std::string& scene,
                                                SecurityOptions& security) {
  if (a.http.empty()) return std::optional<DisplayOptions>();
  DisplayOptions options;
  QUARRY_ASSIGN(options.listen, ParseEndpoint(a.http, "--http"));
  QUARRY_ASSIGN(options.view_memory, ParseSize(a.view_memory, "--view-memory"));
  options.up_axis = a.up_axis == "y" ? 1 : a.up_axis == "z" ? 2 : 0;
  QUARRY_ASSIGN(options.token, ReadToken(a.token_file));
  options.tls = {security.tls_cert, security.tls_key};
  options.viewer_urls = a.viewer_urls;
  options.name = std::filesystem::path(scene).stem().string();
  options.store = StoreForPeople(scene);
  if (!security.secret_file.empty() || security.tls_ca.empty()) security.tls_cert = security.tls_key = "";
  return std::optional(std::move(options));
}

Status Run(MasterOptions options, SecurityOptions security, const std::string& listen,
           const std::string& schedule, const std::string& foresight, const std::string& frame_memory,
           const DisplayArguments& display, const RemoteArguments& remote) {
  security = WithEnvironment(security);
  QUARRY_TRY(CheckOutputs(options, security, display.token_file));
  QUARRY_ASSIGN(options.display, DisplayOf(display, options.scene, security));
  if (!display.preparing.empty()) return ServePreparing(*options.display, display.preparing);
  QUARRY_ASSIGN(options.listen, ParseEndpoint(listen, "--listen"));
  QUARRY_ASSIGN(options.policy, ParsePolicy(schedule));
  QUARRY_ASSIGN(options.foresight_bytes, ParseSize(foresight, "--foresight"));
  QUARRY_ASSIGN(options.frame_memory, ParseSize(frame_memory, "--frame-memory"));
  QUARRY_ASSIGN(options.security, Security::ForServer(security));
  QUARRY_ASSIGN(options.http, ReadRemoteArguments(remote));
  // Workers fetch from the server themselves: this master would only pass bytes on.
  if (IsRemote(options.scene) && options.sources.empty()) options.sources = {options.scene};
  return RunMaster(options);
}

int Main(int argc, char** argv) {
  KeepHeapSmall();
  RaiseDescriptorLimit();
  MasterOptions options;
  SecurityOptions security;
  std::string listen = "127.0.0.1:9000", schedule = "footprint", foresight = "256M";
  std::string frame_memory = std::to_string(MemoryLimitBytes() / 2);
  DisplayArguments display;
  CLI::App app{"Serves a scene's voxels, gives tiles to workers and assembles frames.", "quarry-master"};
  app.footer(
      "Examples:\n  quarry-master plant.quarry --listen 127.0.0.1:9000\n"
      "  quarry-master plant.quarry --listen 127.0.0.1:0 --serve-only\n"
      "  quarry-master plant.quarry --source 127.0.0.1:9001 --source 127.0.0.1:9002 --spool jobs\n"
      "  quarry-master plant.quarry --listen 0.0.0.0:9000 --secret-file quarry.secret\n"
      "  quarry-master plant.quarry --http 127.0.0.1:8080\n"
      "With --spool, SIGTERM loses nothing: finished frames are kept, and workers and clients are informed.");
  app.set_version_flag(
      "--version", [] { return VersionText("quarry-master", InstructionSets()); },
      "Print version, build, instruction set and libraries, and exit");
  app.add_option("scene", options.scene, "The scene store: a file, or https://... or s3://BUCKET/KEY")
      ->required();
  app.add_option(
         "--listen", listen,
         "HOST:PORT to listen at (port 0: a free one; beyond loopback only with a secret or certificates)")
      ->envname("QUARRY_LISTEN")
      ->capture_default_str();
  app.add_option("--environment", options.environments,
                 "The store of a photographed sky that views may name; several may be given");
  app.add_flag("--serve-only", options.serve_only, "Only serve voxels");
  app.add_option("--source", options.sources,
                 "Source of the workers' voxels; several share the load: master, HOST:PORT of one with "
                 "--serve-only, file:PATH, https://... (default: the scene's server, else this master)")
      ->envname("QUARRY_SOURCE");
  app.add_option("--schedule", schedule, "How tiles are given to workers: footprint, last-owner or random")
      ->capture_default_str();
  app.add_option("--foresight", foresight,
                 "Memory for voxels of coarse rays, which predict the blocks of tiles; 0: no prediction")
      ->capture_default_str();
  app.add_option("--frame-memory", frame_memory,
                 "Memory for jobs and their pictures until clients have received them; a job that needs more "
                 "is refused (default: half of this machine's, or of its cgroup's limit)")
      ->envname("QUARRY_FRAME_MEMORY");
  app.add_option("--spool", options.spool,
                 "Keep jobs and finished frames in this folder; a restarted master continues them");
  app.add_option("--trace", options.trace,
                 "Write each tile's blocks and cost to this file, one JSON object a line");
  auto* const http = app.add_option(
      "--http", display.http,
      "Show the live view at HOST:PORT (beyond loopback with --tls-cert and --tls-key); the address "
      "with its token is printed");
  app.add_option("--viewer-url", display.viewer_urls,
                 "The address at which browsers reach --http through a proxy; several may be given")
      ->needs(http);
  app.add_option(
         "--view-token-file", display.token_file,
         "File with the live view's token, so that a restarted master has the same (default: a new token)")
      ->needs(http);
  app.add_option("--up-axis", display.up_axis, "The live view's up axis, y or z (default: the scene's)")
      ->check(CLI::IsMember({"y", "z"}))
      ->needs(http);
  app.add_option("--view-memory", display.view_memory,
                 "Memory limit of all live views together; a viewer that needs more is refused")
      ->needs(http)
      ->capture_default_str();
  app.add_option("--preparing", display.preparing,
                 "Show the progress of preprocessing instead, read from this file, as `quarry view` does")
      ->needs(http);
  AddSecurityOptions(app, security);
  RemoteArguments remote;
  AddRemoteOptions(app, remote);
  app.add_flag("--quiet", options.quiet, "Print errors only");
  constexpr NoEffect kNoEffect[] = {{"--schedule", "--serve-only"},     {"--foresight", "--serve-only"},
                                    {"--frame-memory", "--serve-only"}, {"--spool", "--serve-only"},
                                    {"--trace", "--serve-only"},        {"--source", "--serve-only"},
                                    {"--http", "--serve-only"}};
  RefuseWithoutEffect(app, kNoEffect);
  if (const auto ended = ParseCommandLine(app, argc, argv)) return *ended;
  return ExitStatus(Run(options, security, listen, schedule, foresight, frame_memory, display, remote));
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry-master", "finished frames have been sent to their clients"}, argc, argv,
                            quarry::Main);
}
