#pragma once

#include <string>

#include "common/base/status.h"
#include "common/remote/http_options.h"

struct ssl_ctx_st;

namespace quarry {

/// Makes a TLS context believe the authorities of `options.tls_ca`, else of the files that AWS_CA_BUNDLE and
/// SSL_CERT_FILE name, else the system's. Errors (permanent): a file that cannot be read, or is a
/// FIFO or device, or has no certificate.
Status UseAuthorities(ssl_ctx_st* context, const HttpOptions& options);

/// Advice for a certificate that is not believed: "--http-ca or SSL_CERT_FILE gives authorities".
std::string AuthorityAdvice(const HttpOptions& options);

}  // namespace quarry
