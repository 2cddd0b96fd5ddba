#pragma once

#include <cstddef>
#include <deque>
#include <string>
#include <utility>

#include "common/http/http_server.h"

namespace quarry {

/// Reasons of refused WebSockets, for pages that ask: a browser hides the answer to a WebSocket from its
/// page. A page names each try by a word of its own (`live?try=WORD`) and asks for it afterwards
/// (`refusal?try=WORD`). Not thread-safe.
class SocketRefusals {
 public:
  /// Number of tries that are remembered: enough for all pages that fail within the second that a question
  /// takes.
  static constexpr size_t kMost = 64;

  /// Records the refusal of a request that names its try.
  void Note(const HttpRequest& request, const std::string& sentence);
  /// The sentence; 404 if no such try was refused here.
  HttpResponse Answer(const HttpRequest& request) const;

 private:
  std::deque<std::pair<std::string, std::string>> refused_;  ///< by the try's word
};

/// The sentence about a request for a WebSocket whose header Upgrade is missing: a proxy has removed it.
/// Proxies pass the other headers of WebSockets. Empty: the request was not for a WebSocket.
std::string SwallowedUpgrade(const HttpRequest& request);

}  // namespace quarry
