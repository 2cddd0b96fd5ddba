#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/http/http_server.h"

namespace quarry {

/// The address under which browsers see the live view when a proxy or tunnel stands before it.
struct ViewerUrl {
  bool https = false;
  std::string host;  ///< lower case; IPv6 in brackets
  uint16_t port = 80;
  std::string path;  ///< begins and ends with "/"

  /// "https://example.org/a/b/"; the scheme's own port is left out.
  std::string text() const;
};

/// Parses --viewer-url: "http://" or "https://", a host, perhaps a port, perhaps a path.
/// Errors (usage): another scheme; a user, query or fragment; a host that is none.
Result<ViewerUrl> ParseViewerUrl(const std::string& text);

struct AccessOptions {
  std::string token;                   ///< empty: a new one is made
  std::vector<std::string> hosts;      ///< names and addresses of this machine that browsers may use
  std::vector<ViewerUrl> viewer_urls;  ///< of proxies before this server
  bool tls = false;                    ///< this server speaks HTTPS
};

/// Decides whether a request to the live view is allowed. The session's token lets a browser see the model;
/// the token stands in the printed address and is exchanged for a cookie with the first request. The cookie's
/// value is a hash of the token: a master that is started again with the same token knows it, and a reader of
/// the browser's cookies does not learn the token. Pure: knows no socket and no clock. Thread-safe.
class Access {
 public:
  /// Errors: the system has no random bytes; (usage) a token that is too short to resist guessing, or has
  /// letters that addresses escape.
  static Result<Access> Make(AccessOptions options);

  const std::string& token() const { return options_.token; }
  /// Has a part of the token's hash: cookies are shared by all ports of a host, and two servers on one host
  /// must not overwrite each other's.
  const std::string& cookie_name() const { return cookie_name_; }

  /// Whether the Host header names this server: a loopback name, one of `hosts`, or a viewer URL's host, each
  /// with any port. A proxy may pass the outer name or the name that it connects to; both are permitted.
  /// Against DNS rebinding: a page elsewhere whose name resolves to this machine is of the same origin for
  /// the browser, but it cannot change the Host header.
  bool HostPermitted(const HttpRequest& request) const;

  /// Whether the page that opens a WebSocket is this server's: its Origin has the host and port of the Host
  /// header, or is that of a viewer URL. An Origin without encryption is none of this server's where the
  /// server speaks HTTPS, or the Host header is that of a viewer URL with https. Against cross-site
  /// WebSockets: browsers send them from any page, with cookies and without asking; pages of other local
  /// servers too, since cookies know no ports. Requires: HostPermitted().
  bool OriginPermitted(const HttpRequest& request) const;

  /// Whether the request has the session's cookie.
  bool HasSession(const HttpRequest& request) const;

  /// Whether the request is the first of a session: GET of a path that ends with "/", with ?token=TOKEN. The
  /// answer sets the cookie, and the page takes the token out of the address bar, so that bookmarks, shared
  /// screens and logs of proxies do not spread it.
  bool HasToken(const HttpRequest& request) const;

  /// Whether the request may read statistics: with the cookie, with "Authorization: Bearer TOKEN", or without
  /// either from this machine itself.
  /// Against a proxy on this machine, for which all the world comes from loopback: with headers that proxies
  /// add, or with a viewer URL that is not a loopback name, the token is needed.
  /// Requires: HostPermitted(), against DNS rebinding.
  bool MayReadStatistics(const HttpRequest& request) const;

  /// The value of Set-Cookie for a request with the token. HttpOnly: scripts cannot read it. SameSite=Strict:
  /// other sites' requests come without it. No Path: the browser takes the page's, whatever prefix a proxy
  /// adds. Secure: never sent without encryption when the viewer comes by HTTPS.
  std::string SetCookie(const HttpRequest& request) const;

 private:
  Access() = default;

  AccessOptions options_;
  std::string cookie_name_;
  std::string session_;  ///< the cookie's value
};

}  // namespace quarry
