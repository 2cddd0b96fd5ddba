#pragma once

#include <cstdint>
#include <ctime>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "worker/sources/aws_signature.h"
#include "worker/sources/http_header.h"

namespace quarry {

/// A file on an HTTP server.
struct HttpLocation {
  bool tls = false;
  std::string host;  ///< a name or an address; IPv6 without brackets
  uint16_t port = 80;
  std::string target = "/";  ///< path and query, percent-encoded, as sent

  /// The Host header: with the port unless it is the scheme's own.
  std::string authority() const;
  /// The address for messages. The query is left out: signed addresses carry their secret there.
  std::string text() const;
};

/// "http://HOST[:PORT]/PATH" or "https://…"; "http://[::1]:8000/a" for IPv6.
/// Errors (usage; the sentence names `what`): another scheme, no host, no port number, a user or password in
/// it, a fragment, characters that have to be percent-encoded.
Result<HttpLocation> ParseHttpLocation(const std::string& url, const std::string& what);

/// How a server is asked.
struct HttpOptions {
  std::vector<HttpHeader> headers;    ///< added to each request
  std::optional<AwsCredentials> aws;  ///< each request is signed with them; no other Authorization then
  std::string tls_ca;                 ///< PEM file of the authorities believed; empty: the system's
  std::function<std::time_t()> now;   ///< the time of signatures; null: the system's clock
  uint32_t connections = 6;           ///< at once
  double connect_s = 10;              ///< until connected, TLS included
  double first_byte_s = 20;           ///< from a request until the head of its answer is there
  double stall_s = 10;                ///< in which at least 4 KiB more, or the rest, must come
};

/// A server that may be sent headers and signatures.
struct HttpServer {
  std::string host;   ///< lower case; IPv6 without brackets
  uint16_t port = 0;  ///< 0: any
  bool operator==(const HttpServer&) const = default;
};
/// "HOST" (any port), "HOST:PORT" or "[ADDRESS]:PORT". Errors (usage; the sentence names `what`): none of
/// these.
Result<HttpServer> ParseHttpServer(const std::string& text, const std::string& what);
/// `options` for `location`: without headers and credentials unless it is one of `servers`.
HttpOptions OptionsFor(const HttpLocation& location, HttpOptions options,
                       std::span<const HttpServer> servers);

/// Headers from a file: lines "Name: value"; empty lines and those that begin with # are skipped.
/// Errors (usage, naming file and line, never a value): cannot be read; others than its owner may read it;
/// longer than 64 KiB; a name that is none or that requests bring themselves (Host, Range, Connection, …); a
/// control character in a value, a carriage return before the end of the line included.
Result<std::vector<HttpHeader>> ReadHttpHeaders(const std::string& path);

/// Credentials from a file, JSON as AWS tools print it: {"AccessKeyId": "…", "SecretAccessKey": "…",
/// "SessionToken": "…", "Region": "…"}; the token may be missing, and the region where AWS_REGION is set.
/// Errors (usage): as for ReadHttpHeaders; not such JSON; a key missing or not of printable ASCII.
Result<AwsCredentials> ReadAwsCredentials(const std::string& path);

/// Credentials from AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN (may be missing) and
/// AWS_REGION. Errors (usage): one missing or not of printable ASCII.
Result<AwsCredentials> AwsCredentialsFromEnvironment();

}  // namespace quarry
