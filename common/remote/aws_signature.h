#pragma once

#include <ctime>
#include <string>
#include <vector>

#include "common/remote/http_header.h"

namespace quarry {

/// Credentials for signing requests to S3 and compatible stores.
struct AwsCredentials {
  std::string region;  ///< "eu-central-1"; other stores define their own names
  std::string access_key, secret_key;
  std::string session_token;  ///< may be empty

  bool operator==(const AwsCredentials&) const = default;
};

/// A GET request without a body, as it will be sent.
struct AwsRequest {
  std::string host;                 ///< the Host header: with a port unless it is the scheme's default
  std::string target;               ///< path and query, percent-encoded
  std::vector<HttpHeader> headers;  ///< further headers to sign: Range, and all that begin with x-amz-
};

/// Computes the headers to add to `request`: x-amz-content-sha256, x-amz-date, x-amz-security-token if there
/// is a token, and Authorization. The signature covers these, the Host header and `request.headers`.
/// Units: `now` in seconds since 1970; servers accept a signature for 15 minutes. Thread-safe.
/// Source: AWS Signature Version 4, "Authenticating Requests: Using the Authorization Header".
std::vector<HttpHeader> SignAwsRequest(const AwsRequest& request, const AwsCredentials& credentials,
                                       std::time_t now);

}  // namespace quarry
