#include "common/remote/http_options.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <fstream>

#include "common/remote/aws_profile.h"
#include "common/remote/http_answer.h"
#include "common/remote/http_proxy.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using Catch::Matchers::Contains;

void WriteText(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
  ::chmod(path.c_str(), 0600);
}

HttpLocation Location(const std::string& url) {
  auto location = ParseHttpLocation(url, "the address");
  REQUIRE(location.has_value());
  return *location;
}

}  // namespace

TEST_CASE("Addresses of HTTP servers are parsed") {
  const HttpLocation plain = Location("http://store.example/a/b.quarry?x=1");
  CHECK(
      (!plain.tls && plain.host == "store.example" && plain.port == 80 && plain.target == "/a/b.quarry?x=1"));
  CHECK(plain.authority() == "store.example");
  CHECK(plain.text() == "http://store.example/a/b.quarry?…");
  const HttpLocation secure = Location("HTTPS://[::1]:8443/s");
  CHECK((secure.tls && secure.host == "::1" && secure.port == 8443));
  CHECK(secure.authority() == "[::1]:8443");
  CHECK(Location("https://h/s").port == 443);
  for (const char* bad :
       {"", "http", "ftp://h/s", "http://", "http:///s", "http://h", "http://h:0/s", "http://h:99999/s",
        "http://h:/s", "http://h:8x/s", "http://user:secret@h/s", "http://h/s#f", "http://h/a b",
        "http://h/a\r\nX: y", "http://h\r\n/s", "http://[::1/s", "http://[h]x/s", "http://h/\xc3\xa4"}) {
    INFO(bad);
    const auto location = ParseHttpLocation(bad, "--source");
    REQUIRE(!location.has_value());
    CHECK(location.error().exit_status() == 2);
    CHECK(location.error().message.find("secret") == std::string::npos);
  }
}

TEST_CASE("Headers and signatures are sent to named servers only") {
  HttpOptions all;
  all.headers = {{"Authorization", "secret"}};
  all.aws.emplace();
  all.tls_ca = "ca";
  const auto sent = [&](const std::string& url, const std::string& server) {
    const auto named = ParseHttpAuthority(server, "--http-header-host");
    REQUIRE(named);
    const HttpOptions options = OptionsFor(Location(url), all, std::span(&*named, 1));
    CHECK(options.headers.empty() == !options.aws);
    CHECK(options.tls_ca == "ca");
    return !options.headers.empty();
  };
  CHECK(sent("https://Store.Example/s", "store.example"));
  CHECK(sent("https://store.example:8443/s", "STORE.example"));
  CHECK(sent("https://store.example:8443/s", "store.example:8443"));
  CHECK(sent("http://[::1]:80/s", "[::1]:80"));
  CHECK_FALSE(sent("https://store.example:8443/s", "store.example:443"));
  CHECK_FALSE(sent("https://store.example.evil/s", "store.example"));
  CHECK_FALSE(sent("https://a.store.example/s", "store.example"));
  CHECK(OptionsFor(Location("https://h/s"), all, {}).headers.empty());
  for (const char* bad : {"", "http://h", "h:0", "h:99999", "a b", "[::1"})
    CHECK_FALSE(ParseHttpAuthority(bad, "--http-header-host").has_value());
}

TEST_CASE("Headers are read from a file that only its owner can read") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("headers");
  WriteText(path, "# token of the test\n\nAuthorization: Bearer abc.def \r\nX-Team:a b\n");
  const auto headers = ReadHttpHeaders(path);
  REQUIRE(headers.has_value());
  CHECK(*headers == std::vector<HttpHeader>{{"Authorization", "Bearer abc.def"}, {"X-Team", "a b"}});
  for (const mode_t mode : {0640, 0604, 0622}) {
    ::chmod(path.c_str(), mode);
    const auto refused = ReadHttpHeaders(path);
    REQUIRE(!refused.has_value());
    CHECK_THAT(refused.error().message, Contains("chmod 600"));
  }
  ::chmod(path.c_str(), 0600);
  for (const std::string bad :
       {"no colon secret", ": secret", "Na me: secret", "A: secret\rHost: b", "A: secret\x01",
        "Range: secret", "hOsT: secret", "Transfer-Encoding: secret", "A\r: secret"}) {
    INFO(bad);
    WriteText(path, "A: b\n" + bad + "\n");
    const auto refused = ReadHttpHeaders(path);
    REQUIRE(!refused.has_value());
    CHECK(refused.error().exit_status() == 2);
    CHECK_THAT(refused.error().message, Contains("line 2"));
    CHECK(refused.error().message.find("secret") == std::string::npos);
  }
  WriteText(path, std::string(70'000, '#'));
  CHECK(!ReadHttpHeaders(path).has_value());
  CHECK(!ReadHttpHeaders(folder.path()).has_value());
  CHECK(!ReadHttpHeaders(folder.file("none")).has_value());
}

TEST_CASE("AWS credentials are read from a file or the environment") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("aws.json");
  WriteText(
      path,
      R"({"Version": 1, "AccessKeyId": "A", "SecretAccessKey": "S", "SessionToken": "T", "Region": "r"})");
  const auto from_file = ReadAwsCredentials(path);
  REQUIRE(from_file.has_value());
  CHECK(*from_file == AwsCredentials{"r", "A", "S", "T"});
  ::chmod(path.c_str(), 0644);
  CHECK(!ReadAwsCredentials(path).has_value());
  for (const char* bad : {"", "[]", "{", R"({"AccessKeyId": "A", "Region": "r"})",
                          R"({"AccessKeyId": "A\nB", "SecretAccessKey": "S", "Region": "r"})",
                          R"({"AccessKeyId": 1, "SecretAccessKey": "S", "Region": "r"})"}) {
    INFO(bad);
    WriteText(path, bad);
    const auto refused = ReadAwsCredentials(path);
    REQUIRE(!refused.has_value());
    CHECK(refused.error().exit_status() == 2);
  }
  ::setenv("AWS_ACCESS_KEY_ID", "A", 1);
  ::setenv("AWS_SECRET_ACCESS_KEY", "S", 1);
  ::unsetenv("AWS_SESSION_TOKEN");
  ::unsetenv("AWS_REGION");
  ::unsetenv("AWS_DEFAULT_REGION");
  ::setenv("HOME", folder.path().c_str(), 1);  // has no .aws
  CHECK(AwsCredentialsFromEnvironment().value() == AwsCredentials{"us-east-1", "A", "S", ""});
  ::setenv("AWS_DEFAULT_REGION", "d", 1);
  CHECK(AwsCredentialsFromEnvironment().value() == AwsCredentials{"d", "A", "S", ""});
  ::setenv("AWS_REGION", "r", 1);
  const auto from_environment = AwsCredentialsFromEnvironment();
  REQUIRE(from_environment.has_value());
  CHECK(*from_environment == AwsCredentials{"r", "A", "S", ""});
  for (const char* name : {"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION", "AWS_DEFAULT_REGION"})
    ::unsetenv(name);
}

TEST_CASE("AWS credentials are read from profiles, as the tools of AWS write them") {
  const test::TemporaryFolder folder;
  const std::string credentials = folder.file("credentials"), config = folder.file("config");
  WriteText(credentials,
            "# kept by aws configure\n[default]\naws_access_key_id = A\naws_secret_access_key=S/x+=\n\n"
            "[work]\r\naws_access_key_id=W\r\naws_secret_access_key = V  \r\naws_session_token = T\r\n");
  WriteText(
      config,
      "[default]\nregion = eu-north-1\ns3 =\n  region = nested\n[profile work]\nregion=eu-west-9 # here\n"
      "endpoint_url = http://127.0.0.1:9/x\n[profile single]\nsso_session = mine\nregion = r\n");
  const char* const names[] = {"AWS_ACCESS_KEY_ID",  "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN",
                               "AWS_REGION",         "AWS_DEFAULT_REGION",    "AWS_PROFILE",
                               "AWS_DEFAULT_PROFILE"};
  for (const char* name : names) ::unsetenv(name);
  ::setenv("AWS_SHARED_CREDENTIALS_FILE", credentials.c_str(), 1);
  ::setenv("AWS_CONFIG_FILE", config.c_str(), 1);
  CHECK(HasAwsCredentials().value());
  CHECK(AwsCredentialsFromEnvironment().value() == AwsCredentials{"eu-north-1", "A", "S/x+=", ""});
  ::setenv("AWS_PROFILE", "work", 1);
  CHECK(AwsCredentialsFromEnvironment().value() == AwsCredentials{"eu-west-9", "W", "V", "T"});
  CHECK(ReadAwsProfile()->endpoint == "http://127.0.0.1:9/x");
  ::setenv("AWS_REGION", "r2", 1);
  CHECK(AwsCredentialsFromEnvironment()->region == "r2");
  ::setenv("AWS_PROFILE", "single", 1);
  CHECK_THAT(AwsCredentialsFromEnvironment().error().message,
             Contains("sso_session") && Contains("export-credentials --profile single"));
  ::setenv("AWS_PROFILE", "absent", 1);
  CHECK_THAT(AwsCredentialsFromEnvironment().error().message, Contains("no profile absent"));
  ::setenv("AWS_PROFILE", "work", 1);
  ::setenv("AWS_CONFIG_FILE", folder.file("none").c_str(), 1);
  CHECK_FALSE(AwsCredentialsFromEnvironment().has_value());
  ::unsetenv("AWS_CONFIG_FILE");
  ::unsetenv("AWS_SHARED_CREDENTIALS_FILE");
  for (const char* name : names) ::unsetenv(name);
}

TEST_CASE("Proxies are taken from the environment, except for hosts that need none") {
  const char* const names[] = {"http_proxy", "https_proxy", "HTTPS_PROXY", "all_proxy",
                               "ALL_PROXY",  "no_proxy",    "NO_PROXY",    "HTTP_PROXY"};
  for (const char* name : names) ::unsetenv(name);
  const auto proxy_for = [](const std::string& url) {
    const auto proxy = ProxyFor(*ParseHttpLocation(url, "it"));
    if (!proxy) return proxy.error().message;
    return *proxy ? fmt::format("{}:{} {}", (*proxy)->host, (*proxy)->port, (*proxy)->authorization) : "none";
  };
  CHECK(proxy_for("http://models.example/x") == "none");
  ::setenv("HTTP_PROXY", "http://evil:1", 1);
  CHECK(proxy_for("http://models.example/x") == "none");
  ::setenv("http_proxy", "http://proxy.example:3128/", 1);
  CHECK(proxy_for("http://models.example/x") == "proxy.example:3128 ");
  CHECK(proxy_for("https://models.example/x") == "none");
  ::setenv("HTTPS_PROXY", "user:p%40ss@10.0.0.1", 1);
  CHECK(proxy_for("https://models.example/x") == "10.0.0.1:80 Basic dXNlcjpwQHNz");
  for (const char* local : {"http://localhost/x", "http://127.0.0.5:80/x", "http://[::1]/x"})
    CHECK(proxy_for(local) == "none");
  ::setenv("no_proxy", "a.example, .b.example ,c.example:81, 10.1.2.3", 1);
  for (const char* direct : {"http://a.example/x", "http://sub.A.example/x", "http://z.b.example/x",
                             "http://c.example:81/x", "http://10.1.2.3/x"})
    CHECK(proxy_for(direct) == "none");
  for (const char* proxied : {"http://xa.example/x", "http://c.example/x", "http://10.1.2.4/x"})
    CHECK(proxy_for(proxied) == "proxy.example:3128 ");
  ::setenv("no_proxy", "*", 1);
  CHECK(proxy_for("http://models.example/x") == "none");
  ::unsetenv("no_proxy");
  ::setenv("http_proxy", "socks5://user:secret@h:1", 1);
  CHECK_THAT(proxy_for("http://models.example/x"), Contains("http_proxy: only HTTP proxies"));
  CHECK(proxy_for("http://models.example/x").find("secret") == std::string::npos);
  for (const char* name : names) ::unsetenv(name);
}

TEST_CASE("A redirection leads to an absolute address or a relative one, and never from https to http") {
  const auto to = [](const std::string& from, const std::string& target) {
    const auto location = RedirectedTo(*ParseHttpLocation(from, "it"), target);
    if (!location) return location.error().message;
    return fmt::format("{}://{}{}", location->tls ? "https" : "http", location->authority(),
                       location->target);
  };
  CHECK(to("http://h:8/a/b?q", "https://o.example/x?sig=1#f") == "https://o.example/x?sig=1");
  CHECK(to("http://h:8/a/b?q", "/x?sig=1") == "http://h:8/x?sig=1");
  CHECK(to("http://h:8/a/b?q", "c") == "http://h:8/a/c");
  CHECK(to("http://h:8/a/b?q", "?r") == "http://h:8/a/b?r");
  CHECK(to("https://h/a", "//o/x") == "https://o/x");
  CHECK_THAT(to("https://h/a", "http://o/x?secret"), Contains("from https to http://o/x?"));
  CHECK(to("https://h/a", "http://o/x?secret").find("secret") == std::string::npos);
  CHECK_THAT(to("http://h/a", "ftp://o/x"), Contains("neither http:// nor https://"));
  CHECK_THAT(to("http://h/a", "http://user@o/x"), Contains("user or password"));
  CHECK_THAT(to("http://h/a", ""), Contains("redirects without an address"));
}

// Examples of "Signature Calculations for the Authorization Header" in the S3 API reference: 24 May 2013.
TEST_CASE("Signatures equal Amazon's published examples") {
  const AwsCredentials credentials{"us-east-1", "AKIAIOSFODNN7EXAMPLE",
                                   "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY", ""};
  constexpr std::time_t kThen = 1369353600;
  struct Example {
    std::string target;
    std::vector<HttpHeader> headers;
    std::string names, signature;
  };
  const std::string host = "examplebucket.s3.amazonaws.com";
  const std::string names = "host;x-amz-content-sha256;x-amz-date";
  for (const Example& e : std::vector<Example>{
           {"/test.txt",
            {{"Range", "bytes=0-9"}},
            "host;range;x-amz-content-sha256;x-amz-date",
            "f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41"},
           {"/?lifecycle", {}, names, "fea454ca298b7da1c68078a5d1bdbfbbe0d65c699e0f91ac7a200a0136783543"},
           {"/?max-keys=2&prefix=J",
            {},
            names,
            "34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7"},
           {"/?prefix=J&max-keys=2",
            {},
            names,
            "34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7"}}) {
    INFO(e.target);
    const auto added = SignAwsRequest({host, e.target, e.headers}, credentials, kThen);
    CHECK(added ==
          std::vector<HttpHeader>{
              {"x-amz-content-sha256", "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"},
              {"x-amz-date", "20130524T000000Z"},
              {"Authorization",
               "AWS4-HMAC-SHA256 Credential=AKIAIOSFODNN7EXAMPLE/20130524/us-east-1/s3/"
               "aws4_request,SignedHeaders=" +
                   e.names + ",Signature=" + e.signature}});
  }
}

TEST_CASE("A path has the same signature however it is encoded, and a token is signed") {
  const AwsCredentials credentials{"r", "A", "S", "token"};
  const auto sign = [&](const std::string& target) {
    return SignAwsRequest({"h", target, {}}, credentials, 0);
  };
  CHECK(sign("/a%2Db/~c%20d") == sign("/a-b/%7ec%20d"));
  CHECK(sign("/a+b") == sign("/a%2bb"));
  CHECK(sign("/a") != sign("/b"));
  CHECK(sign("/100%") == sign("/100%25"));
  const auto added = sign("/a");
  REQUIRE(added.size() == 4);
  CHECK(added[2] == HttpHeader{"x-amz-security-token", "token"});
  CHECK_THAT(added[3].value, Contains("host;x-amz-content-sha256;x-amz-date;x-amz-security-token"));
}

}  // namespace quarry
