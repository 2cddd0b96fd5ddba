#pragma once

#include <cstdint>
#include <ctime>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/remote/aws_signature.h"
#include "common/remote/http_header.h"

namespace quarry {

/// The address of a file on an HTTP server.
struct HttpLocation {
  bool tls = false;
  std::string host;  ///< a name or an address; IPv6 without brackets
  uint16_t port = 80;
  std::string target = "/";  ///< path and query, percent-encoded, as sent

  /// The Host header: with the port unless it is the scheme's default.
  std::string authority() const;
  /// The address for messages. Omits the query, where signed addresses carry their secret.
  std::string text() const;
};

/// Parses "http://HOST[:PORT]/PATH" or "https://...", with "http://[::1]:8000/a" for IPv6.
/// Errors (usage; the message names `what`): another scheme; no host; an invalid port; a user or password; a
/// fragment; characters that must be percent-encoded.
Result<HttpLocation> ParseHttpLocation(const std::string& url, const std::string& what);

/// Settings of requests. Units: the names ending in _s are in seconds.
struct HttpOptions {
  std::vector<HttpHeader> headers;    ///< added to each request
  std::optional<AwsCredentials> aws;  ///< each request is signed with them; replaces other Authorization
  /// PEM file of trusted authorities; empty: the files of AWS_CA_BUNDLE and SSL_CERT_FILE, else the system's
  std::string tls_ca;
  std::string ca_option;             ///< the program's option for `tls_ca`, for advice; empty: it has none
  std::function<std::time_t()> now;  ///< clock for signatures; null: the system's
  uint32_t connections = 6;          ///< connections at once
  double connect_s = 10;             ///< limit for connecting, TLS included
  double first_byte_s = 20;          ///< limit from a request to the end of its answer's head
  double stall_s = 10;               ///< limit for the next 4 KiB, or for the rest, of a body
  /// Bytes a second: after stall_s, a body that has come more slowly is given up. A judgement: a block of
  /// 256 KiB then takes 16 s, and six connections 0.8 Mbit/s.
  double least_rate = 16 << 10;
};

/// A server that may receive headers and signatures.
struct HttpAuthority {
  std::string host;   ///< lower case; IPv6 without brackets
  uint16_t port = 0;  ///< 0: any port
  bool operator==(const HttpAuthority&) const = default;
};
/// Parses "HOST" (any port), "HOST:PORT" or "[ADDRESS]:PORT". Errors (usage; the message names `what`): other
/// text.
Result<HttpAuthority> ParseHttpAuthority(const std::string& text, const std::string& what);
/// The options for `location`: without headers and credentials unless `servers` names its server.
HttpOptions OptionsFor(const HttpLocation& location, HttpOptions options,
                       std::span<const HttpAuthority> servers);

/// Reads headers from a file of lines "Name: value". Skips empty lines and lines that begin with #.
/// Errors (usage; the message names file and line, never a value): cannot be read; other users may read it;
/// longer than 64 KiB; an invalid name, or a header that requests set themselves (Host, Range, Connection,
/// ...); a control character in a value, such as a carriage return inside the line.
Result<std::vector<HttpHeader>> ReadHttpHeaders(const std::string& path);

/// Reads credentials from a file with JSON as AWS tools print it: {"AccessKeyId": "...", "SecretAccessKey":
/// "...", "SessionToken": "...", "Region": "..."}. The token is optional; AWS_REGION or AWS_DEFAULT_REGION
/// replaces a missing region. Errors (usage): as for ReadHttpHeaders(); invalid JSON; a value missing or not
/// printable ASCII.
Result<AwsCredentials> ReadAwsCredentials(const std::string& path);

/// Reads credentials from AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_SESSION_TOKEN (optional); else
/// from the profile of ~/.aws (ReadAwsProfile()). The region is AwsRegion().
/// Errors (usage): no credentials, or half of them; keys that a program of AWS would have to fetch; a value
/// that is not printable ASCII; as ReadAwsProfile().
Result<AwsCredentials> AwsCredentialsFromEnvironment();
/// Whether variables or the profile have credentials, or say how to get them. Errors: as ReadAwsProfile().
Result<bool> HasAwsCredentials();

}  // namespace quarry
