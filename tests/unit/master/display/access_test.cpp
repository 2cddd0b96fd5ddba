#include "master/display/access.h"

#include <catch2/catch.hpp>
#include <string>
#include <utility>
#include <vector>

namespace quarry {
namespace {

using Catch::Matchers::Contains;
using Headers = std::vector<std::pair<std::string, std::string>>;

const std::string kToken = "0123456789abcdef0123456789abcdef";

HttpRequest Request(Headers headers, const std::string& path = "/", const std::string& query = "") {
  HttpRequest request;
  request.method = "GET";
  request.path = path;
  request.query = query;
  request.headers = std::move(headers);
  return request;
}

ViewerUrl Url(const std::string& text) {
  const auto url = ParseViewerUrl(text);
  INFO(text);
  REQUIRE(url.has_value());
  return *url;
}

Access Make(std::vector<std::string> viewer_urls = {}, std::vector<std::string> hosts = {},
            bool tls = false) {
  AccessOptions options{kToken, std::move(hosts), {}, tls};
  for (const std::string& url : viewer_urls) options.viewer_urls.push_back(Url(url));
  return *Access::Make(std::move(options));
}

/// The value of the session's cookie.
std::string SessionOf(const Access& access) {
  const std::string set = access.SetCookie(Request({{"host", "localhost:8080"}}));
  const size_t begin = set.find('=') + 1;
  return set.substr(begin, set.find(';') - begin);
}

struct Case {
  const char* value;
  bool permitted;
};

}  // namespace

TEST_CASE("A made token has 32 random bytes", "[access]") {
  const Access one = *Access::Make({}), other = *Access::Make({});
  CHECK(one.token().size() == 64);
  CHECK(one.token().find_first_not_of("0123456789abcdef") == std::string::npos);
  CHECK(one.token() != other.token());
  CHECK(one.cookie_name() != other.cookie_name());
}

TEST_CASE("A given token is accepted when it cannot be guessed and needs no escapes", "[access]") {
  CHECK(Access::Make({kToken, {}, {}, false})->token() == kToken);
  CHECK(Access::Make({"AZaz09-_AZaz09-_", {}, {}, false}).has_value());
  for (const char* token : {"short", "fifteen-letters", "0123456789abcdef 0123456789", "0123456789abcdef%2D",
                            "0123456789abcdef;a=b", "0123456789abcdef\r\nA: b", "0123456789abcdg\xc3\xa9"}) {
    const auto access = Access::Make({token, {}, {}, false});
    INFO(token);
    REQUIRE_FALSE(access.has_value());
    CHECK(access.error().exit_status() == 2);
    CHECK_THAT(access.error().message, Contains("openssl rand -hex 32"));
  }
}

TEST_CASE("The cookie's name differs between tokens, is constant for each, and holds no token", "[access]") {
  const Access access = Make();
  CHECK(access.cookie_name() == Make().cookie_name());
  CHECK(access.cookie_name() != Access::Make({kToken + "0", {}, {}, false})->cookie_name());
  CHECK_THAT(access.cookie_name(), Catch::StartsWith("quarry-"));
  CHECK(access.cookie_name().size() == 7 + 12);
  CHECK_THAT(kToken, !Contains(access.cookie_name().substr(7)));
}

TEST_CASE("A Host header names this machine's loopback, its own hosts or a viewer URL", "[access]") {
  const Access access = Make({"https://Viewer.Example.org/a/b/", "http://[2001:DB8::1]:8000"},
                             {"node7", "10.0.0.7", "fe80::0:7"});
  for (const Case& c : {
           Case{"localhost", true},
           {"localhost:8080", true},
           {"LOCALHOST:1", true},
           {"127.0.0.1:65535", true},
           {"[::1]", true},
           {"[::1]:9000", true},
           {"[0:0:0:0:0:0:0:1]:9000", true},
           {"node7:8443", true},
           {"NODE7", true},
           {"10.0.0.7", true},
           {"[fe80::7]:1", true},
           {"viewer.example.org", true},
           {"VIEWER.example.ORG:444", true},
           {"[2001:db8:0::1]", true},
           {"", false},
           {"evil.example.com", false},
           {"localhost.evil.example.com", false},
           {"evil-localhost", false},
           {"viewer.example.org.evil.com", false},
           {"example.org", false},
           {"127.0.0.2", false},
           {"127.0.0.1.evil.com", false},
           {"localhost:", false},
           {"localhost:0", false},
           {"localhost:65536", false},
           {"localhost:80a", false},
           {"localhost:-1", false},
           {"localhost:80:80", false},
           {"local%68ost", false},
           {"localhost%00", false},
           {"user@localhost", false},
           {"localhost/", false},
           {"localhost, localhost", false},
           {" localhost", false},
           {"::1", false},
           {"[::1", false},
           {"[::1]x", false},
           {"[::1]:x", false},
           {"[::1%25lo]", false},
           {"[]", false},
           {"[localhost]", false},
           {":80", false},
       }) {
    INFO(c.value);
    CHECK(access.HostPermitted(Request({{"host", c.value}})) == c.permitted);
  }
  CHECK_FALSE(access.HostPermitted(Request({})));
  CHECK_FALSE(access.HostPermitted(Request({{"host", "localhost"}, {"host", "localhost"}})));
  CHECK_FALSE(Make().HostPermitted(Request({{"host", "node7"}})));
}

TEST_CASE("A WebSocket's Origin is the page's host or a viewer URL", "[access]") {
  const Access access = Make({"https://viewer.example.org/a/b/", "http://plain.example.org:8000"}, {"node7"});
  const auto permitted = [&](const std::string& host, const std::string& origin) {
    return access.OriginPermitted(Request({{"host", host}, {"origin", origin}}));
  };
  for (const Case& c : {
           Case{"https://node7:8443", true},
           {"http://node7:8443", true},
           {"HTTPS://NODE7:8443", true},
           {"https://viewer.example.org", true},
           {"https://viewer.example.org:443", true},
           {"http://plain.example.org:8000", true},
           {"http://localhost:1234", false},
           {"http://127.0.0.1", false},
           {"https://[::1]:5", false},
           {"https://node7", false},
           {"https://node7:8444", false},
           {"https://node77:8443", false},
           {"http://viewer.example.org", false},
           {"http://viewer.example.org:443", false},
           {"https://viewer.example.org:444", false},
           {"https://plain.example.org:8000", false},
           {"http://plain.example.org", false},
           {"https://evil.example.com", false},
           {"https://viewer.example.org.evil.com", false},
           {"https://viewer.example.org/", false},
           {"https://evil.example.com?viewer.example.org", false},
           {"https://evil.example.com#@localhost", false},
           {"https://user@localhost", false},
           {"http://local%68ost", false},
           {"http://localhost.", false},
           {"null", false},
           {"NULL", false},
           {"", false},
           {"localhost", false},
           {"//localhost", false},
           {"file://localhost", false},
           {"ws://localhost", false},
           {"chrome-extension://localhost", false},
           {"https://", false},
           {"http://localhost, http://localhost", false},
       }) {
    INFO(c.value);
    CHECK(permitted("node7:8443", c.value) == c.permitted);
  }
  CHECK_FALSE(access.OriginPermitted(Request({{"host", "node7:8443"}})));
  CHECK_FALSE(access.OriginPermitted(Request({{"origin", "https://node7"}})));
  // The scheme's own port may be left out on either side.
  CHECK(permitted("node7", "https://node7"));
  CHECK(permitted("node7:443", "https://node7"));
  CHECK(permitted("node7:80", "http://node7"));
  CHECK_FALSE(permitted("node7:443", "http://node7"));
}

TEST_CASE("A page without encryption cannot open the WebSocket of an encrypted view", "[access]") {
  const auto permitted = [](const Access& access, const std::string& host, const std::string& origin) {
    return access.OriginPermitted(Request({{"host", host}, {"origin", origin}}));
  };
  const Access access = Make({"https://viewer.example.org/a/", "https://localhost:8443/"});
  CHECK_FALSE(permitted(access, "viewer.example.org", "http://viewer.example.org"));
  CHECK_FALSE(permitted(access, "viewer.example.org:443", "http://viewer.example.org:443"));
  CHECK_FALSE(permitted(access, "localhost:8443", "http://localhost:8443"));
  CHECK(permitted(access, "viewer.example.org", "https://viewer.example.org"));
  CHECK(permitted(access, "localhost:8443", "https://localhost:8443"));
  // This server's own address, beside the proxy's.
  CHECK(permitted(access, "localhost:8080", "http://localhost:8080"));
  CHECK(permitted(access, "127.0.0.1:8080", "http://127.0.0.1:8080"));
  // The same proxy without encryption, where that was asked for.
  const Access both = Make({"https://viewer.example.org/", "http://viewer.example.org/"});
  CHECK(permitted(both, "viewer.example.org", "http://viewer.example.org"));
  const Access tls =
      Access::Make({.token = "a-token-of-the-tests-0123456789", .hosts = {"node7"}, .tls = true}).value();
  CHECK_FALSE(permitted(tls, "node7:8443", "http://node7:8443"));
  CHECK(permitted(tls, "node7:8443", "https://node7:8443"));
}

TEST_CASE("Behind a proxy the page's origin must fit the outer name, whichever Host the proxy sends",
          "[access]") {
  const Access access = Make({"https://hpc.example.org/rnode/n7/8080/"}, {"127.0.0.1"});
  for (const char* host : {"127.0.0.1:8080", "hpc.example.org"}) {
    const HttpRequest request = Request({{"host", host}, {"origin", "https://hpc.example.org"}});
    CHECK(access.HostPermitted(request));
    CHECK(access.OriginPermitted(request));
  }
}

TEST_CASE("A tunnel's other port is of the same origin as its Host", "[access]") {
  const Access access = Make();
  const HttpRequest request = Request({{"host", "localhost:9000"}, {"origin", "http://localhost:9000"}});
  CHECK(access.HostPermitted(request));
  CHECK(access.OriginPermitted(request));
}

TEST_CASE("The session's cookie does not reveal the token, and is constant for each token", "[access]") {
  const std::string session = SessionOf(Make());
  CHECK(session.size() == 64);
  CHECK(session == SessionOf(Make()));
  CHECK(session != SessionOf(*Access::Make({kToken + "0", {}, {}, false})));
  CHECK_THAT(session, !Contains(kToken));
  CHECK_FALSE(Make().HasToken(Request({}, "/", "token=" + session)));
}

TEST_CASE("The session is a cookie of the right name and value, among whatever others", "[access]") {
  const Access access = Make();
  const std::string name = access.cookie_name(), session = SessionOf(access), good = name + "=" + session;
  for (const auto& [cookies, has] : std::vector<std::pair<std::string, bool>>{
           {good, true},
           {"a=b; " + good, true},
           {good + "; a=b", true},
           {"a=b;" + good + ";c=d", true},
           {"a; =; ;" + good, true},
           {name + "=wrong; " + good, true},
           {"", false},
           {";", false},
           {"=", false},
           {name, false},
           {name + "=", false},
           {name + "=" + session + "0", false},
           {name + "=" + session.substr(1), false},
           {name + "=0123456789ABCDEF0123456789ABCDEF", false},
           {name + "=%30" + session.substr(1), false},
           {name + "=\"" + session + "\"", false},
           {"quarry-000000000000=" + session, false},
           {"x" + good, false},
           {"a=" + good, false},
           {name + "=" + kToken, false},
           {"token=" + kToken, false},
       }) {
    INFO(cookies);
    CHECK(access.HasSession(Request({{"cookie", cookies}})) == has);
  }
  CHECK_FALSE(access.HasSession(Request({})));
  CHECK_FALSE(access.HasSession(Request({}, "/", "token=" + kToken)));
  CHECK(access.HasSession(Request({{"cookie", "a=b"}, {"cookie", good}})));
  CHECK(access.HasSession(Request({{"cookie", good}, {"cookie", "a=b"}})));
}

TEST_CASE("The token of the printed address opens the page and nothing else", "[access]") {
  const Access access = Make();
  const std::string good = "token=" + kToken;
  for (const auto& [query, has] : std::vector<std::pair<std::string, bool>>{
           {good, true},
           {"a=b&" + good, true},
           {good + "&a=b", true},
           {"token=wrong&" + good, true},
           {"", false},
           {"token=", false},
           {"token", false},
           {good + "0", false},
           {"token=0123456789ABCDEF0123456789ABCDEF", false},
           {"token=%30" + kToken.substr(1), false},
           {"t%6Fken=" + kToken, false},
           {"Token=" + kToken, false},
           {"atoken=" + kToken, false},
           {"a=" + good, false},
           {"a;" + good, false},
       }) {
    INFO(query);
    CHECK(access.HasToken(Request({}, "/", query)) == has);
  }
  // Some proxies leave their prefix in the path.
  CHECK(access.HasToken(Request({}, "/node/n7/8080/", good)));
  CHECK_FALSE(access.HasToken(Request({}, "/live", good)));
  CHECK_FALSE(access.HasToken(Request({}, "", good)));
  HttpRequest head = Request({}, "/", good);
  head.method = "HEAD";
  CHECK_FALSE(access.HasToken(head));
}

TEST_CASE("Statistics are served to the session, to the bearer of the token and to this machine",
          "[access]") {
  const Access access = Make();
  const auto may = [](const Access& rules, Headers headers, bool loopback) {
    HttpRequest request = Request(std::move(headers), "/stats");
    request.loopback = loopback;
    return rules.MayReadStatistics(request);
  };
  CHECK(may(access, {{"cookie", access.cookie_name() + "=" + SessionOf(access)}}, false));
  for (const auto& [authorization, permitted] : std::vector<std::pair<std::string, bool>>{
           {"Bearer " + kToken, true},
           {"bearer  " + kToken + " ", true},
           {"BEARER " + kToken, true},
           {kToken, false},
           {"Bearer" + kToken, false},
           {"Bearer ", false},
           {"Bearer", false},
           {"", false},
           {"Basic " + kToken, false},
           {"Bearer " + kToken + "0", false},
           {"Bearer " + kToken + ", Bearer " + kToken, false},
       }) {
    INFO(authorization);
    CHECK(may(access, {{"authorization", authorization}}, false) == permitted);
  }
  CHECK_FALSE(may(access, {}, false));
  CHECK(may(access, {}, true));
  for (const char* header : {"x-forwarded-for", "x-forwarded-proto", "x-real-ip", "forwarded", "via"})
    CHECK_FALSE(may(access, {{header, "127.0.0.1"}}, true));
  CHECK_FALSE(may(Make({"https://viewer.example.org/"}), {}, true));
  CHECK(may(Make({"http://localhost:9000/"}), {}, true));
}

TEST_CASE("The cookie is sent with this site's requests only, and only over HTTPS where the viewer uses it",
          "[access]") {
  const auto cookie = [](const Access& access, const std::string& host) {
    return access.SetCookie(Request({{"host", host}}));
  };
  const std::string plain = Make().cookie_name() + "=" + SessionOf(Make()) + "; HttpOnly; SameSite=Strict",
                    secure = plain + "; Secure";
  CHECK(cookie(Make(), "localhost:8080") == plain);
  CHECK(cookie(Make({}, {}, true), "localhost:8080") == secure);
  CHECK(cookie(Make({"http://viewer.example.org/"}), "viewer.example.org") == plain);
  // The proxy may send its own Host.
  CHECK(cookie(Make({"https://viewer.example.org/"}), "viewer.example.org") == secure);
  CHECK(cookie(Make({"https://viewer.example.org/"}), "127.0.0.1:8080") == secure);
  const std::vector<std::string> both{"https://viewer.example.org/", "http://plain.example.org:8000"};
  CHECK(cookie(Make(both), "plain.example.org:8000") == plain);
  CHECK(cookie(Make(both), "viewer.example.org") == secure);
  CHECK(cookie(Make(both, {}, true), "plain.example.org:8000") == secure);
}

TEST_CASE("A viewer URL has a scheme, a host and optionally a port and a path", "[access]") {
  const auto text = [](const std::string& url) { return Url(url).text(); };
  CHECK(text("https://example.org") == "https://example.org/");
  CHECK(text("HTTPS://Example.ORG/A/b") == "https://example.org/A/b/");
  CHECK(text("http://example.org:80/a/b/") == "http://example.org/a/b/");
  CHECK(text("https://example.org:80") == "https://example.org:80/");
  CHECK(text("http://[0:0::1]:8080/x%20y/") == "http://[::1]:8080/x%20y/");
  CHECK(text("http://node_7:1") == "http://node_7:1/");
  const ViewerUrl url = Url("https://example.org/a");
  CHECK(url.https);
  CHECK(url.host == "example.org");
  CHECK(url.port == 443);
  CHECK(url.path == "/a/");
}

TEST_CASE("An invalid viewer URL is refused with the reason", "[access]") {
  for (const auto& [text, why] : std::vector<std::pair<std::string, std::string>>{
           {"", "http:// or https://"},
           {"example.org", "http:// or https://"},
           {"ftp://example.org", "http:// or https://"},
           {"javascript:alert(1)", "http:// or https://"},
           {"https://", "no host"},
           {"https:///a", "no host"},
           {"https://:80", "no host"},
           {"https://example.org:0", "an invalid port"},
           {"https://example.org:99999", "an invalid port"},
           {"https://example.org:", "an invalid port"},
           {"https://exa%6Dple.org", "no host"},
           {"https://user:word@example.org", "user name"},
           {"https://example.org/?a=b", "'?' or '#'"},
           {"https://example.org#a", "'?' or '#'"},
           {"https://example.org/a b", "character"},
           {"https://example.org/\n", "character"},
           {"https://b\xc3\xbc"
            "cher.example",
            "character"},
           {"https://[::1", "no host"},
           {"https://::1/", "no host"},
       }) {
    const auto url = ParseViewerUrl(text);
    INFO(text);
    REQUIRE_FALSE(url.has_value());
    CHECK(url.error().exit_status() == 2);
    CHECK_THAT(url.error().message, Contains(why) && Contains("--viewer-url '"));
  }
}

}  // namespace quarry
