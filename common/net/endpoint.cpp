// Apart from connection.cpp, so that a program can link its own connections: see tests/fuzz/memory_net.h.

#include <fmt/format.h>

#include <charconv>

#include "common/net/connection.h"

namespace quarry {

Result<Endpoint> ParseEndpoint(const std::string& text, const std::string& what) {
  const size_t colon = text.rfind(':');
  Endpoint endpoint;
  if (colon != std::string::npos && colon > 0) {
    const char* end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data() + colon + 1, end, endpoint.port);
    endpoint.host = text.substr(0, colon);
    if (endpoint.host.size() > 2 && endpoint.host.front() == '[')
      endpoint.host = endpoint.host.substr(1, colon - 2);
    if (error == std::errc{} && rest == end) return endpoint;
  }
  return BadUsage(fmt::format("{} is not HOST:PORT: '{}'", what, text));
}

std::string TextOf(const Endpoint& endpoint) {
  const bool v6 = endpoint.host.find(':') != std::string::npos;
  return fmt::format(fmt::runtime(v6 ? "[{}]:{}" : "{}:{}"), endpoint.host, endpoint.port);
}

}  // namespace quarry
