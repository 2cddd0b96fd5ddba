#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <utility>

#include "tests/support/servers/http_fetches.h"
#include "tests/support/servers/nginx.h"
#include "tests/support/skip.h"
#include "worker/sources/http_source.h"

// Blocks from a real web server.

namespace quarry {
namespace {

using Catch::Matchers::Contains;
using test::CheckAllBlocks;
using test::FetchOne;
using test::Location;
using test::Nginx;
using test::Patient;
using Scene = test::ServedScene;

bool SkippedWithoutNginx() {
  if (!Nginx::Program().empty()) return false;
  test::Skip("nginx is not installed (deploy/install installs nginx-light)");
  return true;
}

}  // namespace

TEST_CASE("Every block is read through nginx as it is in the store") {
  if (SkippedWithoutNginx()) return;
  const Scene scene(60);
  const auto nginx =
      Nginx::Start(scene.folder.file("nginx"), scene.folder.path(),
                   "location /closing/ { alias " + scene.folder.path() +
                       "/; keepalive_requests 3; }\n"
                       "location /protected/ { alias " +
                       scene.folder.path() +
                       "/;\n"
                       "  if ($http_authorization != \"Bearer secret-of-the-test\") { return 403; } }\n"
                       "location /whole/ { alias " +
                       scene.folder.path() + "/; max_ranges 0; }\n");
  REQUIRE(nginx.has_value());
  const std::string base = fmt::format("http://127.0.0.1:{}", (*nginx)->port());
  boost::asio::io_context io;
  {
    HttpVoxelSource source(io, Location(base + "/scene.quarry"), scene.catalog(), Patient());
    CheckAllBlocks(io, source, *scene.store);
    CHECK(source.counters().http.connections <= HttpOptions().connections);
  }
  {
    HttpVoxelSource source(io, Location(base + "/closing/scene.quarry"), scene.catalog(), Patient());
    CheckAllBlocks(io, source, *scene.store);
  }
  const auto fault = [&](const std::string& path, HttpOptions options = Patient()) {
    HttpVoxelSource source(io, Location(base + path), scene.catalog(), std::move(options));
    const auto got = FetchOne(io, source, 0_b);
    REQUIRE(!got.has_value());
    CHECK(got.error().permanent());
    return got.error().message;
  };
  CHECK_THAT(fault("/none.quarry"), Contains("/none.quarry: answers 404 Not Found"));
  CHECK_THAT(fault("/whole/scene.quarry"), Contains("does not serve ranges"));
  CHECK_THAT(fault("/protected/scene.quarry"), Contains("403 Forbidden"));
  HttpOptions options = Patient();
  options.headers = {{"Authorization", "Bearer wrong-token"}};
  CHECK_THAT(fault("/protected/scene.quarry", options), Contains("403") && !Contains("wrong-token"));
  options.headers = {{"Authorization", "Bearer secret-of-the-test"}};
  HttpVoxelSource source(io, Location(base + "/protected/scene.quarry"), scene.catalog(), options);
  CheckAllBlocks(io, source, *scene.store);
}

TEST_CASE("Blocks are fetched by https from a server with a trusted certificate, and from no other") {
  if (SkippedWithoutNginx()) return;
  if (std::system("openssl version >/dev/null 2>&1") != 0) {
    test::Skip("the openssl program is not installed");
    return;
  }
  const Scene scene(30);
  const std::string pem = scene.folder.file("server.pem"), certificate = scene.folder.file("certificate.pem");
  REQUIRE(std::system(
              fmt::format("cd {} && openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost "
                          "-addext subjectAltName=DNS:localhost -keyout key.pem -out certificate.pem "
                          "2>/dev/null && cat certificate.pem key.pem > server.pem",
                          scene.folder.path())
                  .c_str()) == 0);
  const auto nginx = Nginx::Start(scene.folder.file("nginx"), scene.folder.path(), "", pem);
  REQUIRE(nginx.has_value());
  const auto url = [&](const std::string& host) {
    return Location(fmt::format("https://{}:{}/scene.quarry", host, (*nginx)->port()));
  };
  boost::asio::io_context io;
  HttpOptions options = Patient();
  options.tls_ca = certificate;
  {
    HttpVoxelSource source(io, url("localhost"), scene.catalog(), options);
    CheckAllBlocks(io, source, *scene.store);
    CHECK(source.counters().http.connections <= options.connections);
  }
  const auto fault = [&](const HttpLocation& location, const HttpOptions& how) {
    HttpVoxelSource source(io, location, scene.catalog(), how);
    const auto got = FetchOne(io, source, 0_b);
    REQUIRE(!got.has_value());
    CHECK(got.error().permanent());
    return got.error().message;
  };
  CHECK_THAT(fault(url("127.0.0.1"), options), Contains("not for 127.0.0.1"));
  CHECK_THAT(fault(url("localhost"), Patient()), Contains("not trusted"));
  options.tls_ca = scene.folder.file("none.pem");
  CHECK_THAT(fault(url("localhost"), options), Contains("none.pem"));
  // Plain HTTP to the same port is told by nginx, and is no TLS.
  HttpLocation plain = url("localhost");
  plain.tls = false;
  CHECK_THAT(fault(plain, Patient()), Contains("400 Bad Request"));
}

}  // namespace quarry
