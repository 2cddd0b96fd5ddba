#include "worker/metrics.h"

#include <openssl/crypto.h>

#include <utility>

#include "common/http/metrics.h"

namespace quarry {
namespace {

std::string Format(const WorkerStatus& c) {
  using enum Metric::Kind;
  const auto number = [](uint64_t value) { return static_cast<double>(value); };
  const auto seconds = [](uint64_t us) { return static_cast<double>(us) * 1e-6; };
  const Metric metrics[] = {
      {"quarry_rays_traced_total", "Rays traced", kCounter, number(c.rays)},
      {"quarry_rays_suspended_total", "Times that a ray waited for a voxel", kCounter,
       number(c.rays_suspended)},
      {"quarry_voxel_loaded_bytes_total", "Stored bytes of voxels loaded", kCounter,
       number(c.voxel_bytes_loaded)},
      {"quarry_voxel_received_bytes_total", "Stored bytes of voxels received from sources", kCounter,
       number(c.voxel_bytes_received)},
      {"quarry_voxel_evictions_total", "Blocks evicted from the cache", kCounter, number(c.evictions)},
      {"quarry_compute_seconds_total", "Processor time on rays, over all threads", kCounter,
       seconds(c.compute_us)},
      {"quarry_stall_seconds_total", "Time of threads whose rays all waited", kCounter, seconds(c.stall_us)},
      {"quarry_cache_resident_bytes", "Decoded voxels held", kGauge, number(c.cache_bytes)},
      {"quarry_peak_resident_bytes", "Peak memory of the process", kGauge, number(c.peak_rss_bytes)}};
  return FormatMetrics(metrics);
}

/// Whether a program of this machine asks for this machine, and no proxy for somebody else: a page whose name
/// leads here cannot change the Host header.
bool IsLocal(const HttpRequest& request) {
  const std::string host = request.header("host");
  const std::string name = host.substr(0, host.rfind(':'));
  const bool named = name == "localhost" || name == "127.0.0.1" || name == "[::1]";
  return request.loopback && named && request.header("x-forwarded-for").empty() &&
         request.header("forwarded").empty() && request.header("via").empty();
}

/// Compared in constant time, against guessing by time.
bool ShowsToken(const HttpRequest& request, const std::string& token) {
  const std::string shown = request.header("authorization"), right = "Bearer " + token;
  return !token.empty() && shown.size() == right.size() &&
         CRYPTO_memcmp(shown.data(), right.data(), right.size()) == 0;
}

}  // namespace

Result<std::unique_ptr<HttpServer>> ServeMetrics(boost::asio::io_context& io, const MetricsOptions& options,
                                                 std::function<WorkerStatus()> counters) {
  const auto answer = [token = options.token, counters = std::move(counters)](const HttpRequest& request) {
    if (request.path == "/healthz") return HttpResponse{.body = "ok\n"};
    if (request.path != "/metrics")
      return HttpResponse{.status = 404, .body = "there is /metrics and /healthz\n"};
    if (!IsLocal(request) && !ShowsToken(request, token))
      return HttpResponse{.status = 403, .body = "readers from other machines need the token\n"};
    return HttpResponse{.content_type = kMetricsType, .body = Format(counters())};
  };
  return HttpServer::Open(io, {.listen = options.listen, .tls = options.tls}, {answer, {}, {}});
}

}  // namespace quarry
