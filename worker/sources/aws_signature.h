#pragma once

#include <ctime>
#include <string>
#include <vector>

#include "worker/sources/http_header.h"

namespace quarry {

/// What S3 and the stores that speak like it give out to sign requests with.
struct AwsCredentials {
  std::string region;  ///< "eu-central-1"; what the store calls its own, if it is not Amazon's
  std::string access_key, secret_key;
  std::string session_token;  ///< empty: none

  bool operator==(const AwsCredentials&) const = default;
};

/// A GET without a body, as it will go out.
struct AwsRequest {
  std::string host;                 ///< the Host header: with the port if it is not the scheme's own
  std::string target;               ///< path and query, percent-encoded
  std::vector<HttpHeader> headers;  ///< others to be signed: Range, and all that begin with x-amz-
};

/// The headers to add to `request`: x-amz-content-sha256, x-amz-date, x-amz-security-token where there is
/// one, and Authorization, which signs those, the Host header and `request.headers`.
/// `now`: seconds since 1970; servers take a request for 15 minutes. Thread-safe.
/// Source: AWS Signature Version 4, "Authenticating Requests: Using the Authorization Header".
std::vector<HttpHeader> SignAwsRequest(const AwsRequest& request, const AwsCredentials& credentials,
                                       std::time_t now);

}  // namespace quarry
