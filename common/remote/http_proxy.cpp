#include "common/remote/http_proxy.h"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <cstdlib>
#include <initializer_list>
#include <string_view>

#include "common/remote/environment.h"

namespace quarry {
namespace {

bool IsLoopback(const std::string& host) {
  if (Lower(host) == "localhost") return true;
  boost::system::error_code error;
  const auto address = boost::asio::ip::make_address(host, error);
  return !error && address.is_loopback();
}

/// Whether one item of no_proxy covers the host.
bool Covers(std::string_view item, const std::string& host, uint16_t port) {
  if (item == "*") return true;
  if (item.starts_with('[')) {  // [ADDRESS] or [ADDRESS]:PORT
    const size_t end = item.find(']');
    if (end == std::string_view::npos) return false;
    const std::string_view rest = item.substr(end + 1);
    return item.substr(1, end - 1) == host && (rest.empty() || rest == fmt::format(":{}", port));
  }
  if (std::ranges::count(item, ':') == 1) {
    if (item.substr(item.find(':') + 1) != std::to_string(port)) return false;
    item = item.substr(0, item.find(':'));
  }
  if (item.starts_with("*.")) item.remove_prefix(1);
  const std::string_view domain = item.starts_with('.') ? item.substr(1) : item;
  if (domain.empty()) return false;
  return host == domain || host.ends_with("." + std::string(domain));
}

bool NeedsNone(const HttpLocation& location) {
  if (IsLoopback(location.host)) return true;
  const std::string host = Lower(location.host), list = Lower(Environment({"no_proxy", "NO_PROXY"}));
  for (size_t at = 0; at < list.size();) {
    const size_t end = std::min(list.find_first_of(", \t", at), list.size());
    if (end > at && Covers(std::string_view(list).substr(at, end - at), host, location.port)) return true;
    at = end + 1;
  }
  return false;
}

std::string Base64(std::string_view text) {
  std::string out(4 * (text.size() / 3 + 1) + 1, '\0');
  const int size =
      EVP_EncodeBlock(reinterpret_cast<unsigned char*>(out.data()),
                      reinterpret_cast<const unsigned char*>(text.data()), static_cast<int>(text.size()));
  out.resize(static_cast<size_t>(size));
  return out;
}

/// Parses "[http://][USER:PASSWORD@]HOST[:PORT][/]". The message never has the address: it may hold a
/// password.
Result<HttpProxy> ParseProxy(std::string_view text, const char* variable) {
  const auto refuse = [&](const char* why) {
    return BadUsage(fmt::format("{}: {} (give http://HOST:PORT, or unset it)", variable, why));
  };
  if (const size_t scheme = text.find("://"); scheme != std::string_view::npos) {
    if (Lower(text.substr(0, scheme)) != "http") return refuse("only HTTP proxies are supported");
    text.remove_prefix(scheme + 3);
  }
  HttpProxy proxy;
  text = text.substr(0, text.find('/'));
  if (const size_t at = text.rfind('@'); at != std::string_view::npos) {
    proxy.authorization = "Basic " + Base64(PercentDecodedText(text.substr(0, at)));
    text.remove_prefix(at + 1);
  }
  const auto authority = ParseHttpAuthority(std::string(text), variable);
  if (!authority) return refuse("is not the address of a proxy");
  proxy.host = authority->host;
  if (authority->port != 0) proxy.port = authority->port;
  return proxy;
}

}  // namespace

Result<std::optional<HttpProxy>> ProxyFor(const HttpLocation& location) {
  if (NeedsNone(location)) return std::optional<HttpProxy>();
  const std::initializer_list<const char*> plain{"http_proxy", "all_proxy", "ALL_PROXY"},
      secure{"https_proxy", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"};
  for (const char* variable : location.tls ? secure : plain) {
    const std::string text = Environment({variable});
    if (text.empty()) continue;
    QUARRY_ASSIGN(HttpProxy proxy, ParseProxy(text, variable));
    return std::optional(std::move(proxy));
  }
  return std::optional<HttpProxy>();
}

}  // namespace quarry
