#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/http/http_server.h"
#include "master/display/access.h"

namespace quarry {

struct DisplayOptions {
  Endpoint listen{"127.0.0.1", 0};
  TlsFiles tls;
  std::vector<std::string> viewer_urls;  ///< as ParseViewerUrl() reads them
  std::string token;                     ///< of the session; empty: a new one
  uint64_t view_memory = 256u << 20;     ///< bytes that all views may take together
  std::string name;                      ///< of the scene, for people
  std::string store;                     ///< where it is, for a command that renders it
  uint32_t up_axis = 0;                  ///< 1 for y, 2 for z; 0: the scene's
};

// The answers shared by the display's servers. Thread-safe.

/// Decides which requests are allowed. Errors: as Access::Make(); (usage) an invalid viewer URL.
Result<Access> MakeAccess(const DisplayOptions& options);
/// The address with the token, which gives a browser access. `port`: in use.
std::string AddressOf(const DisplayOptions& options, const Access& access, uint16_t port);

/// The last part of a path; a proxy may put anything in front of it.
std::string NameOfPage(const std::string& path);
/// An answer of one sentence.
HttpResponse Refused(int status, const std::string& sentence);
/// The answers that need no session: `healthz`, and refusals of hosts that are not permitted. None: another
/// answer is needed.
std::optional<HttpResponse> AnswerForAll(const HttpRequest& request, const Access& access);
/// The file that a path names. The page itself (`start`) needs the cookie, or the token, which sets the
/// cookie. Without both the answer is the page that explains how to get access.
HttpResponse PageFor(const HttpRequest& request, const Access& access, const std::string& start);

}  // namespace quarry
