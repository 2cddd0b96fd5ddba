#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/remote/http_options.h"

namespace quarry {

/// A proxy for HTTP requests.
struct HttpProxy {
  std::string host;
  uint16_t port = 80;
  std::string authorization;  ///< value of Proxy-Authorization; empty: none

  bool operator==(const HttpProxy&) const = default;
};

/// The proxy that the environment names for requests to `location`: http_proxy for http, https_proxy or
/// HTTPS_PROXY for https, else all_proxy or ALL_PROXY; none for hosts of no_proxy or NO_PROXY, a list of
/// names, addresses and domains ("example.org" and ".example.org" mean all hosts in it too, "*" all hosts),
/// each perhaps with ":PORT". HTTP_PROXY in capitals is not used, as in curl: a web server may set it from a
/// request. A loopback host never gets a proxy.
/// Errors (usage; the message names the variable): an address that is none; a proxy of another kind (https,
/// SOCKS).
Result<std::optional<HttpProxy>> ProxyFor(const HttpLocation& location);

}  // namespace quarry
