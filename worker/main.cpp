#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>

#include "common/base/cleanup.h"
#include "common/base/log.h"
#include "common/base/number.h"
#include "common/base/output_path.h"
#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/command_line/command_line.h"
#include "common/command_line/security_options.h"
#include "common/kdtree/instruction_sets.h"
#include "common/kdtree/kernels.h"
#include "common/net/source_spec.h"
#include "common/program/run_program.h"
#include "common/program/version_text.h"
#include "worker/session.h"

namespace quarry {
namespace {

/// Options that are parsed after the command line is complete.
struct Texts {
  std::string master, cache = "256M", disk_cache, http_header_file, aws, http_ca, metrics, metrics_token_file;
  std::vector<std::string> header_hosts;
  SecurityOptions security;
};

Status ReadSourceOptions(const Texts& texts, WorkerOptions& options) {
  if (!texts.disk_cache.empty()) {
    QUARRY_ASSIGN(options.disk_cache, ParseDiskCache(texts.disk_cache, "--disk-cache"));
    QUARRY_TRY(OutputGuard::TakeFolder(options.disk_cache->folder));
  }
  if (!texts.http_header_file.empty()) {
    QUARRY_ASSIGN(options.http.headers, ReadHttpHeaders(texts.http_header_file));
  }
  if (!texts.aws.empty()) {
    QUARRY_ASSIGN(options.http.aws,
                  texts.aws == "env" ? AwsCredentialsFromEnvironment() : ReadAwsCredentials(texts.aws));
  }
  for (const std::string& host : texts.header_hosts) {
    QUARRY_ASSIGN(HttpAuthority server, ParseHttpAuthority(host, "--http-header-host"));
    options.header_servers.push_back(std::move(server));
  }
  if (!options.header_servers.empty() && texts.http_header_file.empty() && texts.aws.empty())
    return BadUsage("--http-header-host has no effect without --http-header-file or --http-aws");
  options.http.ca_option = "--http-ca";
  options.http.tls_ca = texts.http_ca.empty() ? WithEnvironment(texts.security).tls_ca : texts.http_ca;
  for (const std::string& source : options.sources) QUARRY_TRY(ParseSource(source));
  return {};
}

Result<std::optional<MetricsOptions>> ReadMetricsOptions(const Texts& texts,
                                                         const SecurityOptions& security) {
  if (texts.metrics.empty()) return std::optional<MetricsOptions>();
  MetricsOptions options;
  QUARRY_ASSIGN(options.listen, ParseEndpoint(texts.metrics, "--metrics"));
  options.tls = {security.tls_cert, security.tls_key};
  if (!texts.metrics_token_file.empty()) {
    QUARRY_ASSIGN(const Bytes token, ReadSecret(texts.metrics_token_file));
    options.token = AsText(token);
  }
  return std::optional(std::move(options));
}

Status Run(WorkerOptions options, const Texts& texts) {
  if (Kernels().empty())
    return BadUsage("QUARRY_ISA names no instruction set that this processor has: scalar, avx2 or avx512");
  const SecurityOptions security = WithEnvironment(texts.security);
  QUARRY_ASSIGN(options.master, ParseEndpoint(texts.master, "--master"));
  QUARRY_ASSIGN(options.security, Security::ForClient(security));
  if (auto serving = Security::ForServer(security))
    options.serving = std::move(*serving);
  else if (options.peers == "auto")
    options.peers = "off";
  else if (options.peers != "off")
    return tl::unexpected<Error>(serving.error());
  QUARRY_ASSIGN(options.cache_bytes, ParseSize(texts.cache, "--cache"));
  QUARRY_TRY(ReadSourceOptions(texts, options));
  QUARRY_ASSIGN(options.metrics, ReadMetricsOptions(texts, security));
  return RunWorker(options);
}

int Main(int argc, char** argv) {
  KeepHeapSmall();
  RaiseDescriptorLimit();
  WorkerOptions options;
  Texts texts;
  options.threads = UsableProcessors();
  options.name = fmt::format("{}-{}", HostName(), ::getpid());
  CLI::App app{"Renders tiles for a master, fetching voxels on demand into a cache of fixed size.",
               "quarry-worker"};
  app.footer(
      "Example:\n  quarry-worker --master 127.0.0.1:9000 --cache 512M --threads 4\n"
      "  quarry-worker --master 10.0.0.1:9000 --secret-file quarry.secret --source "
      "http://10.0.0.9/plant.quarry "
      "--disk-cache /var/tmp/quarry:20G\n"
      "SIGTERM makes it leave: it returns tiles not begun, and finishes begun tiles for up to a second.\n"
      "QUARRY_ISA=scalar|avx2|avx512 in the environment narrows the instruction sets used; pixels are the "
      "same.");
  app.set_version_flag(
      "--version", [] { return VersionText("quarry-worker", InstructionSets()); },
      "Print version, build, instruction set and libraries, and exit");
  app.add_option("--master", texts.master, "The master's HOST:PORT")->required()->envname("QUARRY_MASTER");
  app.add_option("--cache", texts.cache, "Memory for voxels, decoded and stored")
      ->envname("QUARRY_CACHE")
      ->capture_default_str();
  app.add_flag(
      "--pretouch", options.pretouch,
      "Allocate the cache's memory at the start: for virtual machines whose host is slow to provide it");
  app.add_option("--threads", options.threads, "Compute threads")
      ->envname("QUARRY_THREADS")
      ->check(WholeNumber(1, 1024))
      ->capture_default_str();
  app.add_option("--name", options.name, "Name in the master's log and statistics (default: HOST-PID)");
  app.add_option("--previous-end", options.previous_end,
                 "The end of the worker that this one replaces, for the live view")
      ->group("");
  app.add_option("--source", options.sources,
                 "Source of voxels, instead of the master's sources; several share the load: master, "
                 "HOST:PORT, file:PATH, http://..., https://... or s3://BUCKET/KEY")
      ->envname("QUARRY_SOURCE");
  app.add_option("--disk-cache", texts.disk_cache,
                 "Keep voxels in a folder, DIR:BYTES, which workers on this machine may share")
      ->envname("QUARRY_DISK_CACHE");
  app.add_option(
      "--http-header-file", texts.http_header_file,
      "File of lines 'Name: value' to send to HTTP servers that --source names; only its owner may read it");
  app.add_option("--http-header-host", texts.header_hosts,
                 "Send headers and signatures also to HOST or HOST:PORT, when only the master names it");
  app.add_option(
      "--http-aws", texts.aws,
      "Sign requests to HTTP servers for S3: a JSON file of credentials, or env for AWS_* variables or the "
      "profile in ~/.aws");
  app.add_option(
      "--http-ca", texts.http_ca,
      "Authorities trusted for https sources, PEM (default: the authorities of --tls-ca, else the system's)");
  app.add_option(
         "--peers", options.peers,
         "Serve voxels to other workers at HOST:PORT; auto: at the address that reaches the master; off")
      ->capture_default_str();
  app.add_option("--retry", options.retry_s, "Seconds to retry a master or a voxel out of reach")
      ->check(RealNumber(0, 1e6))
      ->capture_default_str();
  auto* const metrics = app.add_option(
      "--metrics", texts.metrics,
      "Serve metrics for Prometheus at HOST:PORT (beyond loopback with --tls-cert and --tls-key)");
  app.add_option("--metrics-token-file", texts.metrics_token_file,
                 "File with the token that other machines need to read metrics")
      ->needs(metrics);
  AddSecurityOptions(app, texts.security);
  app.add_flag("--quiet", options.quiet, "Print errors only");
  if (const auto ended = ParseCommandLine(app, argc, argv)) return *ended;
  return ExitStatus(Run(options, texts));
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry-worker", "its tiles are given to other workers"}, argc, argv,
                            quarry::Main);
}
