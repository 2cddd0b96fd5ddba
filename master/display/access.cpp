#include "master/display/access.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <string_view>
#include <utility>

#include "common/base/check.h"
#include "common/http/http_message.h"

namespace quarry {
namespace {

constexpr size_t kTokenBytes = 32;         ///< random bytes of a token: none can be guessed
constexpr size_t kLeastTokenLetters = 16;  ///< of a token that is given; as for a secret file
constexpr size_t kNameBytes = 6;  ///< of the hash in the cookie's name; two servers meet by 1 in 2^48

bool IsDigit(char c) { return c >= '0' && c <= '9'; }
bool IsLetterOrDigit(char c) { return IsDigit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }

std::string Hex(const unsigned char* bytes, size_t count) {
  std::string text;
  for (size_t i = 0; i < count; ++i) text += fmt::format("{:02x}", bytes[i]);
  return text;
}

/// A host and its port, as in a Host header or an origin.
struct Authority {
  std::string host;  ///< lower case; IPv6 in brackets, in its shortest form
  std::optional<uint16_t> port;

  bool operator==(const Authority&) const = default;
};

/// The form of an IPv6 address that browsers send; nothing for other text.
std::optional<std::string> Ipv6Host(const std::string& text) {
  in6_addr address{};
  std::array<char, INET6_ADDRSTRLEN> shortest{};
  if (::inet_pton(AF_INET6, text.c_str(), &address) != 1) return std::nullopt;
  if (!::inet_ntop(AF_INET6, &address, shortest.data(), shortest.size())) return std::nullopt;
  return fmt::format("[{}]", shortest.data());
}

std::optional<std::string> ParseHost(std::string_view text) {
  if (text.size() > 2 && text.front() == '[' && text.back() == ']')
    return Ipv6Host(std::string(text.substr(1, text.size() - 2)));
  const auto fits = [](char c) { return IsLetterOrDigit(c) || c == '.' || c == '-' || c == '_'; };
  if (text.empty() || !std::all_of(text.begin(), text.end(), fits)) return std::nullopt;
  return LowerCase(text);
}

/// Parses "HOST" or "HOST:PORT"; nothing for other text, percent signs and users among it.
std::optional<Authority> ParseAuthority(std::string_view text) {
  Authority authority;
  const size_t colon = text.rfind(':');
  // Colons before the bracket's end belong to an IPv6 address.
  if (colon != std::string_view::npos && text.find(']', colon) == std::string_view::npos) {
    const std::string_view digits = text.substr(colon + 1);
    uint16_t port = 0;
    const auto [rest, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
    if (error != std::errc{} || rest != digits.data() + digits.size() || port == 0) return std::nullopt;
    authority.port = port;
    text = text.substr(0, colon);
  }
  auto host = ParseHost(text);
  if (!host) return std::nullopt;
  authority.host = std::move(*host);
  return authority;
}

/// The parts of an origin: scheme, host and port.
struct Origin {
  bool https = false;
  Authority authority;  ///< with its port
};

uint16_t PortOf(const Authority& authority, bool https) { return authority.port.value_or(https ? 443 : 80); }

/// Takes "http://" or "https://" away from the beginning of `text`. Returns: whether it is the latter;
/// nothing for other schemes.
std::optional<bool> TakeScheme(std::string_view& text) {
  const size_t end = text.find("://");
  if (end == std::string_view::npos) return std::nullopt;
  const std::string scheme = LowerCase(text.substr(0, end));
  if (scheme != "http" && scheme != "https") return std::nullopt;
  text.remove_prefix(end + 3);
  return scheme == "https";
}

std::optional<Origin> ParseOrigin(std::string_view text) {
  const auto https = TakeScheme(text);
  if (!https) return std::nullopt;
  auto authority = ParseAuthority(text);
  if (!authority) return std::nullopt;
  authority->port = PortOf(*authority, *https);
  return Origin{*https, std::move(*authority)};
}

bool IsLoopbackName(const std::string& host) {
  return host == "localhost" || host == "127.0.0.1" || host == "[::1]";
}

/// Calls `use` with each part of `text` between the separators.
template <class Use>
void ForEachPart(std::string_view text, char separator, Use&& use) {
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find(separator, begin), text.size());
    use(text.substr(begin, end - begin));
    begin = end + 1;
  }
}

std::string_view Trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

/// `bytes` bytes of a hash of the token, as hexadecimal digits; another one for each `use`.
std::string HashFor(const std::string& use, const std::string& token, size_t bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  const std::string text = use + " " + token;
  QUARRY_CHECK(EVP_Digest(text.data(), text.size(), digest.data(), &size, EVP_sha256(), nullptr) == 1);
  return Hex(digest.data(), bytes);
}

/// Compared in constant time, against guessing by time.
bool SameSecret(std::string_view text, const std::string& secret) {
  return text.size() == secret.size() && CRYPTO_memcmp(text.data(), secret.data(), secret.size()) == 0;
}

/// Whether a header of a proxy shows that the request came through it.
bool IsForwarded(const HttpRequest& request) {
  return std::any_of(request.headers.begin(), request.headers.end(), [](const auto& header) {
    return header.first == "forwarded" || header.first == "via" || header.first == "x-real-ip" ||
           header.first.rfind("x-forwarded-", 0) == 0;
  });
}

}  // namespace

std::string ViewerUrl::text() const {
  const std::string shown = port == (https ? 443 : 80) ? "" : fmt::format(":{}", port);
  return fmt::format("{}://{}{}{}", https ? "https" : "http", host, shown, path);
}

Result<ViewerUrl> ParseViewerUrl(const std::string& text) {
  const auto refuse = [&](const char* why) {
    return BadUsage(
        fmt::format("--viewer-url '{}': {}; give an address such as https://example.org/view/", text, why));
  };
  std::string_view rest = text;
  const auto https = TakeScheme(rest);
  if (!https) return refuse("does not begin with http:// or https://");
  if (rest.find_first_of("?#") != std::string_view::npos) return refuse("contains '?' or '#'");
  const auto visible = [](char c) {
    return c > ' ' && c < 0x7f && std::string_view("\"<>\\^`{|}").find(c) == std::string_view::npos;
  };
  if (!std::all_of(rest.begin(), rest.end(), visible))
    return refuse("contains a character that is not allowed in addresses");
  const size_t slash = std::min(rest.find('/'), rest.size());
  if (rest.substr(0, slash).find('@') != std::string_view::npos) return refuse("contains a user name");
  const auto authority = ParseAuthority(rest.substr(0, slash));
  if (!authority) return refuse("has no host, or an invalid port");
  ViewerUrl url{*https, authority->host, PortOf(*authority, *https), std::string(rest.substr(slash))};
  if (url.path.empty() || url.path.back() != '/') url.path += '/';
  return url;
}

Result<Access> Access::Make(AccessOptions options) {
  if (options.token.empty()) {
    std::array<unsigned char, kTokenBytes> random{};
    if (::getentropy(random.data(), random.size()) != 0)
      return Fail("the system gives no random bytes for a token");
    options.token = Hex(random.data(), random.size());
  }
  const auto fits = [](char c) { return IsLetterOrDigit(c) || c == '-' || c == '_'; };
  if (options.token.size() < kLeastTokenLetters ||
      !std::all_of(options.token.begin(), options.token.end(), fits))
    return BadUsage(
        fmt::format("a token has at least {} letters, digits, '-' and '_'; 'openssl rand -hex 32' makes one",
                    kLeastTokenLetters));
  Access access;
  // In the form of a Host header; addresses of options have no brackets.
  for (const std::string& host : std::exchange(options.hosts, {})) {
    const auto address = Ipv6Host(host);
    const auto parsed = address ? address : ParseHost(host);
    if (parsed) options.hosts.push_back(*parsed);
  }
  access.cookie_name_ = "quarry-" + HashFor("quarry cookie name", options.token, kNameBytes);
  access.session_ = HashFor("quarry session", options.token, kTokenBytes);
  access.options_ = std::move(options);
  return access;
}

bool Access::HostPermitted(const HttpRequest& request) const {
  const auto host = ParseAuthority(request.header("host"));
  if (!host) return false;
  if (IsLoopbackName(host->host)) return true;
  if (std::find(options_.hosts.begin(), options_.hosts.end(), host->host) != options_.hosts.end())
    return true;
  return std::any_of(options_.viewer_urls.begin(), options_.viewer_urls.end(),
                     [&](const ViewerUrl& url) { return url.host == host->host; });
}

bool Access::OriginPermitted(const HttpRequest& request) const {
  const auto origin = ParseOrigin(request.header("origin"));
  if (!origin) return false;
  for (const ViewerUrl& url : options_.viewer_urls)
    if (url.https == origin->https && Authority{url.host, url.port} == origin->authority) return true;
  auto host = ParseAuthority(request.header("host"));
  if (!host) return false;
  // Somebody on the network can change a page without encryption; such a page must not open an encrypted
  // view.
  const auto with_tls = [&](const ViewerUrl& url) {
    return url.https && url.host == host->host && host->port.value_or(url.port) == url.port;
  };
  if (!origin->https && (options_.tls || std::ranges::any_of(options_.viewer_urls, with_tls))) return false;
  // The Host header has no scheme: TLS may end at a proxy.
  host->port = PortOf(*host, origin->https);
  return *host == origin->authority;
}

bool Access::HasSession(const HttpRequest& request) const {
  bool found = false;
  // Each header by itself: values of several headers are not joined by a semicolon.
  for (const auto& [name, value] : request.headers) {
    if (name != "cookie") continue;
    ForEachPart(value, ';', [&](std::string_view cookie) {
      const size_t equals = cookie.find('=');
      if (equals == std::string_view::npos || Trimmed(cookie.substr(0, equals)) != cookie_name_) return;
      found = SameSecret(Trimmed(cookie.substr(equals + 1)), session_) || found;
    });
  }
  return found;
}

bool Access::HasToken(const HttpRequest& request) const {
  if (request.method != "GET" || request.path.empty() || request.path.back() != '/') return false;
  constexpr std::string_view kName = "token=";
  bool found = false;
  ForEachPart(request.query, '&', [&](std::string_view part) {
    if (part.substr(0, kName.size()) == kName)
      found = SameSecret(part.substr(kName.size()), options_.token) || found;
  });
  return found;
}

bool Access::MayReadStatistics(const HttpRequest& request) const {
  if (HasSession(request)) return true;
  constexpr std::string_view kScheme = "bearer ";
  const std::string authorization = request.header("authorization");
  if (LowerCase(authorization.substr(0, kScheme.size())) == kScheme &&
      SameSecret(Trimmed(std::string_view(authorization).substr(kScheme.size())), options_.token))
    return true;
  const bool proxied =
      IsForwarded(request) || !std::all_of(options_.viewer_urls.begin(), options_.viewer_urls.end(),
                                           [](const ViewerUrl& url) { return IsLoopbackName(url.host); });
  return request.loopback && !proxied;
}

std::string Access::SetCookie(const HttpRequest& request) const {
  const auto host = ParseAuthority(request.header("host"));
  bool secure = false, plain = false;
  for (const ViewerUrl& url : options_.viewer_urls) {
    secure = secure || url.https;
    // This viewer's own address is without encryption: it would lose a Secure cookie.
    plain = plain || (!url.https && host && url.host == host->host && url.port == PortOf(*host, false));
  }
  secure = options_.tls || (secure && !plain);
  return fmt::format("{}={}; HttpOnly; SameSite=Strict{}", cookie_name_, session_, secure ? "; Secure" : "");
}

}  // namespace quarry
