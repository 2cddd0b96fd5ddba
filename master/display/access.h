#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/http/http_server.h"

namespace quarry {

/// The address at which browsers reach the live view through a proxy or tunnel.
struct ViewerUrl {
  bool https = false;
  std::string host;  ///< lower case; IPv6 in brackets
  uint16_t port = 80;
  std::string path;  ///< begins and ends with "/"

  /// "https://example.org/a/b/"; the scheme's own port is left out.
  std::string text() const;
};

/// Parses --viewer-url: "http://" or "https://", a host, perhaps a port, perhaps a path.
/// Errors (usage): another scheme; a user, query or fragment; an invalid host.
Result<ViewerUrl> ParseViewerUrl(const std::string& text);

struct AccessOptions {
  std::string token;                   ///< empty: a new one is made
  std::vector<std::string> hosts;      ///< names and addresses of this machine that browsers may use
  std::vector<ViewerUrl> viewer_urls;  ///< of proxies in front of this server
  bool tls = false;                    ///< this server speaks HTTPS
};

/// Decides whether a request to the live view is allowed. The session's token lets a browser see the model.
/// The printed address contains the token; the first request exchanges it for a cookie. The cookie's value is
/// a hash of the token: a restarted master with the same token accepts it, and it does not reveal the token.
/// Pure: uses no socket and no clock. Thread-safe.
class Access {
 public:
  /// Errors: the system has no random bytes; (usage) a token that is too short to resist guessing, or has
  /// letters that addresses escape.
  static Result<Access> Make(AccessOptions options);

  const std::string& token() const { return options_.token; }
  /// Contains a part of the token's hash: all ports of a host share cookies, and two servers on one host must
  /// not overwrite each other's cookie.
  const std::string& cookie_name() const { return cookie_name_; }

  /// Whether the Host header names this server: a loopback name, one of `hosts`, or a viewer URL's host, each
  /// with any port. A proxy may pass the outer name or the name that it connects to; both are permitted.
  /// Against DNS rebinding: a foreign page whose name resolves to this machine has the same origin for the
  /// browser, but cannot change the Host header.
  bool HostPermitted(const HttpRequest& request) const;

  /// Whether the page that opens a WebSocket is this server's: its Origin has the host and port of the Host
  /// header, or is that of a viewer URL. An Origin without encryption is refused where the server speaks
  /// HTTPS, or where the Host header is that of a viewer URL with https. Against cross-site WebSockets:
  /// browsers open them from any page, with cookies and without a question, also from pages of other local
  /// servers, because cookies do not depend on ports. Requires: HostPermitted().
  bool OriginPermitted(const HttpRequest& request) const;

  /// Whether the request has the session's cookie.
  bool HasSession(const HttpRequest& request) const;

  /// Whether the request is the first of a session: GET of a path that ends with "/", with ?token=TOKEN. The
  /// answer sets the cookie, and the page takes the token out of the address bar, so that bookmarks, shared
  /// screens and logs of proxies do not spread it.
  bool HasToken(const HttpRequest& request) const;

  /// Whether the request may read statistics: it has the cookie or "Authorization: Bearer TOKEN", or it comes
  /// from this machine. A proxy on this machine makes every request come from loopback. So a request with
  /// headers of a proxy needs the token; so does every request where a viewer URL is not a loopback name.
  /// Requires: HostPermitted(), against DNS rebinding.
  bool MayReadStatistics(const HttpRequest& request) const;

  /// The value of Set-Cookie for a request with the token. HttpOnly: scripts cannot read it. SameSite=Strict:
  /// other sites' requests come without it. No Path: the browser takes the page's, whatever prefix a proxy
  /// adds. Secure, if the viewer uses HTTPS: never sent without encryption.
  std::string SetCookie(const HttpRequest& request) const;

 private:
  Access() = default;

  AccessOptions options_;
  std::string cookie_name_;
  std::string session_;  ///< the cookie's value
};

}  // namespace quarry
