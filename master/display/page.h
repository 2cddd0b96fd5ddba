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

// The answers that the display's servers have in common. Thread-safe.

/// Decides which requests get in. Errors: as Access::Make(); (usage) a viewer URL that is none.
Result<Access> MakeAccess(const DisplayOptions& options);
/// The address that lets a browser in, with the token. `port`: in use.
std::string AddressOf(const DisplayOptions& options, const Access& access, uint16_t port);

/// The last part of a path: proxies may put the page under any.
std::string NameOfPage(const std::string& path);
/// An answer of one sentence.
HttpResponse Refused(int status, const std::string& sentence);
/// The answers that need no session: `healthz`, and refusals of hosts that are not permitted. None: it is to
/// be answered otherwise.
std::optional<HttpResponse> AnswerForAll(const HttpRequest& request, const Access& access);
/// The file that a path names. The page itself (`start`) comes with the token, which sets the cookie, or with
/// the cookie; else the page that says how to get in.
HttpResponse PageFor(const HttpRequest& request, const Access& access, const std::string& start);

}  // namespace quarry
