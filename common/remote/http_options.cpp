#include "common/remote/http_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <nlohmann/json.hpp>
#include <string_view>

#include "common/base/json_file.h"
#include "common/remote/aws_profile.h"
#include "common/remote/environment.h"
#include "common/remote/secret_file.h"

namespace quarry {
namespace {

// Headers that requests set themselves.
constexpr std::string_view kOwnHeaders[] = {
    "host",    "range",           "connection",           "content-length", "transfer-encoding", "te",
    "trailer", "accept-encoding", "x-amz-content-sha256", "x-amz-date",     "upgrade",           "expect"};

/// Whether `c` may stand in a header's name (RFC 9110, section 5.6.2).
bool IsTokenCharacter(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
         std::string_view("!#$%&'*+-.^_`|~").find(c) != std::string_view::npos;
}

bool IsPrintable(char c) { return c > ' ' && c <= '~'; }

Result<HttpHeader> ParseHeader(std::string_view line, const std::string& where) {
  const size_t colon = line.find(':');
  const std::string_view name = line.substr(0, colon);
  if (colon == std::string_view::npos || name.empty() || !std::ranges::all_of(name, IsTokenCharacter))
    return BadUsage(fmt::format("{}: is not \"Name: value\"", where));
  if (std::ranges::find(kOwnHeaders, Lower(name)) != std::end(kOwnHeaders))
    return BadUsage(fmt::format("{}: requests set {} themselves; remove the line", where, name));
  const std::string_view value = Trimmed(line.substr(colon + 1));
  const bool clean =
      std::ranges::all_of(value, [](char c) { return c == '\t' || c == ' ' || IsPrintable(c); });
  if (!clean) return BadUsage(fmt::format("{}: the value has a control or non-ASCII character", where));
  return HttpHeader{std::string(name), std::string(value)};
}

/// Checks that the credentials are complete. `source` begins an error's sentence; `names` are the source's
/// names for the region and the keys.
Status CheckCredentials(const AwsCredentials& c, const std::string& source, const char* const (&names)[4]) {
  const std::string* const values[] = {&c.region, &c.access_key, &c.secret_key, &c.session_token};
  for (int i = 0; i < 4; ++i) {
    if (values[i]->empty() && i < 3)
      return BadUsage(
          fmt::format("{}: {} is missing, and requests cannot be signed without it", source, names[i]));
    if (!std::ranges::all_of(*values[i], IsPrintable))
      return BadUsage(fmt::format("{}: {} has a character that is not printable ASCII", source, names[i]));
  }
  return {};
}

/// Splits "HOST", "HOST:PORT" or "[ADDRESS]:PORT". Returns: false for other text.
bool ParseAuthority(std::string_view text, HttpLocation& location) {
  std::string_view port;
  if (text.starts_with('[')) {
    const size_t end = text.find(']');
    if (end == std::string_view::npos) return false;
    location.host = text.substr(1, end - 1);
    port = text.substr(end + 1);
  } else {
    const size_t colon = std::min(text.find(':'), text.size());
    location.host = text.substr(0, colon);
    port = text.substr(colon);
  }
  const bool bracketed = text.starts_with('[');
  const auto belongs = [&](char c) {
    if (bracketed) return std::isxdigit(static_cast<unsigned char>(c)) != 0 || c == ':' || c == '.';
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '.' || c == '_';
  };
  if (location.host.empty() || !std::ranges::all_of(location.host, belongs)) return false;
  if (port.empty()) return true;
  const char* end = port.data() + port.size();
  const auto [rest, error] = std::from_chars(port.data() + 1, end, location.port);
  return port.front() == ':' && error == std::errc{} && rest == end && location.port != 0;
}

}  // namespace

std::string HttpLocation::authority() const {
  const std::string name = host.find(':') == std::string::npos ? host : "[" + host + "]";
  return port == (tls ? 443 : 80) ? name : fmt::format("{}:{}", name, port);
}

std::string HttpLocation::text() const {
  const size_t question = target.find('?');
  return fmt::format("{}://{}{}{}", tls ? "https" : "http", authority(), target.substr(0, question),
                     question == std::string::npos ? "" : "?…");
}

Result<HttpLocation> ParseHttpLocation(const std::string& url, const std::string& what) {
  // The message leaves the address out: it may hold a password or a signature.
  const auto refuse = [&](std::string_view why) {
    return BadUsage(fmt::format("{}: {} (give http://HOST[:PORT]/PATH or https://…)", what, why));
  };
  HttpLocation location;
  std::string_view rest = url;
  const std::string scheme = Lower(rest.substr(0, rest.find("://")));
  if (rest.size() == scheme.size() || (scheme != "http" && scheme != "https"))
    return refuse("the address begins with neither http:// nor https://");
  location.tls = scheme == "https";
  location.port = location.tls ? 443 : 80;
  rest.remove_prefix(scheme.size() + 3);
  const size_t path = std::min(rest.find_first_of("/?#"), rest.size());
  const std::string_view authority = rest.substr(0, path);
  if (authority.find('@') != std::string_view::npos)
    return refuse("a user or password in the address is not accepted: give a header");
  if (!ParseAuthority(authority, location)) return refuse("the address has no host, or an invalid port");
  location.target = rest.substr(path);
  if (!location.target.starts_with('/')) return refuse("the address has no path");
  if (location.target.find('#') != std::string::npos) return refuse("the address of a file cannot contain #");
  if (!std::ranges::all_of(location.target, IsPrintable))
    return refuse("spaces, control and non-ASCII characters of the path have to be percent-encoded");
  return location;
}

Result<HttpAuthority> ParseHttpAuthority(const std::string& text, const std::string& what) {
  HttpLocation location;
  location.port = 0;
  if (!ParseAuthority(text, location))
    return BadUsage(fmt::format("{} is HOST or HOST:PORT, not '{}'", what, text));
  return HttpAuthority{Lower(location.host), location.port};
}

HttpOptions OptionsFor(const HttpLocation& location, HttpOptions options,
                       std::span<const HttpAuthority> servers) {
  const std::string host = Lower(location.host);
  const bool named = std::ranges::any_of(servers, [&](const HttpAuthority& server) {
    return server.host == host && (server.port == 0 || server.port == location.port);
  });
  if (named) return options;
  options.headers.clear();
  options.aws.reset();
  return options;
}

Result<std::vector<HttpHeader>> ReadHttpHeaders(const std::string& path) {
  QUARRY_ASSIGN(const std::string text, ReadSecretFile(path));
  std::vector<HttpHeader> headers;
  std::string_view rest = text;
  for (int number = 1; !rest.empty(); ++number) {
    std::string_view line = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(rest.size(), line.size() + 1));
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (Trimmed(line).empty() || line.starts_with('#')) continue;
    QUARRY_ASSIGN(HttpHeader header, ParseHeader(line, fmt::format("{}: line {}", path, number)));
    headers.push_back(std::move(header));
  }
  return headers;
}

Result<AwsCredentials> ReadAwsCredentials(const std::string& path) {
  QUARRY_ASSIGN(const std::string text, ReadSecretFile(path));
  auto parsed = ParseJson<nlohmann::json>(text, path);
  if (!parsed) return BadUsage(parsed.error().message);
  const nlohmann::json json = std::move(*parsed);
  if (!json.is_object()) return BadUsage(fmt::format("{}: is not a JSON object", path));
  const auto value = [&](const char* name) -> std::string {
    const auto found = json.find(name);
    return found != json.end() && found->is_string() ? found->get<std::string>() : "";
  };
  AwsCredentials c{value("Region"), value("AccessKeyId"), value("SecretAccessKey"), value("SessionToken")};
  if (c.region.empty()) c.region = Environment({"AWS_REGION", "AWS_DEFAULT_REGION"});
  QUARRY_TRY(CheckCredentials(c, path, {"Region", "AccessKeyId", "SecretAccessKey", "SessionToken"}));
  return c;
}

Result<AwsCredentials> AwsCredentialsFromEnvironment() {
  QUARRY_ASSIGN(std::string region, AwsRegion());
  if (!Environment({"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"}).empty()) {
    AwsCredentials c{std::move(region), Environment({"AWS_ACCESS_KEY_ID"}),
                     Environment({"AWS_SECRET_ACCESS_KEY"}), Environment({"AWS_SESSION_TOKEN"})};
    QUARRY_TRY(CheckCredentials(
        c, "environment", {"AWS_REGION", "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN"}));
    return c;
  }
  QUARRY_ASSIGN(const AwsProfile profile, ReadAwsProfile());
  if (profile.access_key.empty() && !profile.other_means.empty())
    return BadUsage(fmt::format(
        "the profile {} gets its keys by {}, which is not supported; put them into variables: eval \"$(aws "
        "configure export-credentials --profile {} --format env)\"",
        profile.name, profile.other_means, profile.name));
  if (profile.access_key.empty() && profile.secret_key.empty())
    return BadUsage(
        "no credentials: AWS_ACCESS_KEY_ID is missing, and ~/.aws has none of the profile; requests cannot "
        "be signed without them");
  AwsCredentials c{std::move(region), profile.access_key, profile.secret_key, profile.session_token};
  QUARRY_TRY(CheckCredentials(c, fmt::format("the profile {} of ~/.aws", profile.name),
                              {"region", "aws_access_key_id", "aws_secret_access_key", "aws_session_token"}));
  return c;
}

Result<bool> HasAwsCredentials() {
  if (!Environment({"AWS_ACCESS_KEY_ID"}).empty()) return true;
  QUARRY_ASSIGN(const AwsProfile profile, ReadAwsProfile());
  return !profile.access_key.empty() || !profile.other_means.empty();
}

}  // namespace quarry
