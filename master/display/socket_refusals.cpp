#include "master/display/socket_refusals.h"

#include <algorithm>

#include "master/display/page.h"

namespace quarry {
namespace {

/// The word of a try; empty: none, or a word that our pages do not send.
std::string TryOf(const HttpRequest& request) {
  constexpr size_t kMostLetters = 40;
  const std::string name = "try=";
  if (request.query.rfind(name, 0) != 0 || request.query.size() > name.size() + kMostLetters) return {};
  return request.query.substr(name.size());
}

}  // namespace

void SocketRefusals::Note(const HttpRequest& request, const std::string& sentence) {
  const std::string word = TryOf(request);
  if (word.empty()) return;
  refused_.emplace_back(word, sentence);
  if (refused_.size() > kMost) refused_.pop_front();
}

HttpResponse SocketRefusals::Answer(const HttpRequest& request) const {
  const std::string word = TryOf(request);
  const auto found = std::ranges::find(refused_, word, [](const auto& refused) { return refused.first; });
  if (word.empty() || found == refused_.end()) return Refused(404, "no such connection was refused here");
  return {.body = found->second + "\n"};
}

std::string SwallowedUpgrade(const HttpRequest& request) {
  if (request.header("sec-websocket-key").empty() && request.header("sec-websocket-version").empty())
    return {};
  return "The proxy in front of this page passes no WebSockets: it removes the headers Upgrade and "
         "Connection. "
         "For nginx: proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; proxy_set_header "
         "Connection "
         "\"upgrade\";";
}

}  // namespace quarry
