#include "common/remote/open_store.h"

#include <fmt/format.h>

#include <memory>
#include <string_view>
#include <utility>

#include "common/remote/aws_profile.h"
#include "common/remote/environment.h"
#include "common/remote/remote_file.h"

namespace quarry {
namespace {

constexpr std::string_view kS3 = "s3://";

/// A key as a path in an address: characters that S3 signs percent-encoded are sent percent-encoded too.
std::string Encoded(std::string_view key) {
  std::string out;
  for (const char c : key) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                       std::string_view("-_.~/").find(c) != std::string_view::npos;
    out += plain ? std::string(1, c) : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return out;
}

}  // namespace

bool IsRemote(const std::string& place) {
  return place.starts_with("http://") || place.starts_with("https://") || place.starts_with(kS3);
}

Result<HttpLocation> RemoteLocation(const std::string& place, const std::string& what) {
  if (!place.starts_with(kS3)) return ParseHttpLocation(place, what);
  const std::string rest = place.substr(kS3.size());
  const size_t slash = rest.find('/');
  if (slash == 0 || slash == std::string::npos || slash + 1 == rest.size())
    return BadUsage(fmt::format("{} is not s3://BUCKET/KEY: '{}'", what, place));
  const std::string bucket = rest.substr(0, slash), key = Encoded(std::string_view(rest).substr(slash + 1));
  std::string server = Environment({"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"});
  if (server.empty()) {
    QUARRY_ASSIGN(const AwsProfile profile, ReadAwsProfile());
    server = profile.endpoint;
  }
  if (!server.empty())
    return ParseHttpLocation(
        fmt::format("{}{}{}/{}", server, server.back() == '/' ? "" : "/", Encoded(bucket), key),
        "AWS_ENDPOINT_URL");
  QUARRY_ASSIGN(const std::string region, AwsRegion());
  // A certificate for *.s3.REGION.amazonaws.com does not cover a bucket with dots.
  const std::string address = bucket.find('.') == std::string::npos
                                  ? fmt::format("https://{}.s3.{}.amazonaws.com/{}", bucket, region, key)
                                  : fmt::format("https://s3.{}.amazonaws.com/{}/{}", region, bucket, key);
  return ParseHttpLocation(address, what);
}

Result<HttpOptions> WithCredentials(const std::string& place, HttpOptions options) {
  if (!place.starts_with(kS3) || options.aws || !options.headers.empty()) return options;
  QUARRY_ASSIGN(const bool has, HasAwsCredentials());
  if (has) {
    QUARRY_ASSIGN(options.aws, AwsCredentialsFromEnvironment());
  }
  return options;
}

Result<StoreReader> OpenStore(const std::string& place, const HttpOptions& options) {
  if (!IsRemote(place)) return StoreReader::Open(place);
  QUARRY_ASSIGN(const HttpLocation location, RemoteLocation(place, "the scene"));
  QUARRY_ASSIGN(const HttpOptions signing, WithCredentials(place, options));
  QUARRY_ASSIGN(auto file, RemoteFile::Open(location, signing));
  return StoreReader::Open(std::move(file));
}

}  // namespace quarry
