#pragma once

#include <cstddef>
#include <deque>
#include <string>
#include <utility>

#include "common/http/http_server.h"

namespace quarry {

/// Why WebSockets were refused, for pages that ask: a browser does not tell a page the answer to a WebSocket.
/// A page names each try by a word of its own (`live?try=WORD`) and asks for it afterwards
/// (`refusal?try=WORD`). Not thread-safe.
class SocketRefusals {
 public:
  /// Tries that are remembered: of all pages that fail within the second that a question takes.
  static constexpr size_t kMost = 64;

  /// Notes the refusal of a request that has named its try.
  void Note(const HttpRequest& request, const std::string& sentence);
  /// The sentence; 404 if no such try has been refused: it did not come here.
  HttpResponse Answer(const HttpRequest& request) const;

 private:
  std::deque<std::pair<std::string, std::string>> refused_;  ///< by the word of the try
};

/// The sentence about a request for a WebSocket whose header Upgrade is missing: a proxy has taken it away.
/// Other headers of WebSockets pass proxies. Empty: the request asked for no WebSocket.
std::string SwallowedUpgrade(const HttpRequest& request);

}  // namespace quarry
