#include "common/remote/http_options.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string_view>

#include "common/base/json_file.h"

namespace quarry {
namespace {

// Limit of a file with headers or credentials in bytes; real files are far shorter.
constexpr size_t kMaxFileBytes = 64 << 10;
// Headers that requests set themselves.
constexpr std::string_view kOwnHeaders[] = {
    "host",    "range",           "connection",           "content-length", "transfer-encoding", "te",
    "trailer", "accept-encoding", "x-amz-content-sha256", "x-amz-date",     "upgrade",           "expect"};

std::string Lower(std::string_view text) {
  std::string lower(text);
  std::ranges::transform(lower, lower.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower;
}

/// Whether `c` may stand in a header's name (RFC 9110, section 5.6.2).
bool IsTokenCharacter(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
         std::string_view("!#$%&'*+-.^_`|~").find(c) != std::string_view::npos;
}

bool IsPrintable(char c) { return c > ' ' && c <= '~'; }

struct OpenFd {
  ~OpenFd() {
    if (fd >= 0) ::close(fd);
  }
  int fd;
};

/// Reads the whole of a file that holds a secret.
Result<std::string> ReadSecretFile(const std::string& path) {
  const OpenFd file{::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
  if (file.fd < 0) return BadUsage(fmt::format("{}: cannot open: {}", path, ErrnoText(errno)));
  struct stat info {};
  if (::fstat(file.fd, &info) != 0 || !S_ISREG(info.st_mode))
    return BadUsage(fmt::format("{}: is not a plain file", path));
  if ((info.st_mode & 077) != 0)
    return BadUsage(
        fmt::format("{}: others than its owner may read it, and it holds a secret; do chmod 600", path));
  std::string text(kMaxFileBytes + 1, '\0');
  size_t size = 0;
  while (size < text.size()) {
    const ssize_t n = ::read(file.fd, text.data() + size, text.size() - size);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return BadUsage(fmt::format("{}: cannot read: {}", path, ErrnoText(errno)));
    if (n == 0) break;
    size += static_cast<size_t>(n);
  }
  if (size > kMaxFileBytes) return BadUsage(fmt::format("{}: longer than 64 KiB", path));
  text.resize(size);
  return text;
}

std::string_view Trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

Result<HttpHeader> ParseHeader(std::string_view line, const std::string& where) {
  const size_t colon = line.find(':');
  const std::string_view name = line.substr(0, colon);
  if (colon == std::string_view::npos || name.empty() || !std::ranges::all_of(name, IsTokenCharacter))
    return BadUsage(fmt::format("{}: is not \"Name: value\"", where));
  if (std::ranges::find(kOwnHeaders, Lower(name)) != std::end(kOwnHeaders))
    return BadUsage(fmt::format("{}: requests have their own {}; take the line out", where, name));
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
          fmt::format("{}: {} is missing, and requests cannot be signed without", source, names[i]));
    if (!std::ranges::all_of(*values[i], IsPrintable))
      return BadUsage(fmt::format("{}: {} has a character that is not printable ASCII", source, names[i]));
  }
  return {};
}

std::string FromEnvironment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
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
    return refuse("a user or password in the address is not taken: give a header");
  if (!ParseAuthority(authority, location)) return refuse("the address has no host, or a port that is none");
  location.target = rest.substr(path);
  if (!location.target.starts_with('/')) return refuse("the address has no path");
  if (location.target.find('#') != std::string::npos) return refuse("an address with # is not a file's");
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
  if (c.region.empty()) c.region = FromEnvironment("AWS_REGION");
  QUARRY_TRY(CheckCredentials(c, path, {"Region", "AccessKeyId", "SecretAccessKey", "SessionToken"}));
  return c;
}

Result<AwsCredentials> AwsCredentialsFromEnvironment() {
  const AwsCredentials c{FromEnvironment("AWS_REGION"), FromEnvironment("AWS_ACCESS_KEY_ID"),
                         FromEnvironment("AWS_SECRET_ACCESS_KEY"), FromEnvironment("AWS_SESSION_TOKEN")};
  QUARRY_TRY(CheckCredentials(
      c, "environment", {"AWS_REGION", "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN"}));
  return c;
}

}  // namespace quarry
