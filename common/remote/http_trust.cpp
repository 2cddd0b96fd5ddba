#include "common/remote/http_trust.h"

#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/ssl.h>

#include "common/remote/environment.h"
#include "common/remote/secret_file.h"

namespace quarry {
namespace {

tl::unexpected<Error> Unreadable(const std::string& what, const std::string& why) {
  return tl::unexpected<Error>(
      Error{fmt::format("{}: cannot read certificate authorities: {}", what, why), ErrorKind::kPermanent});
}

std::string LastError() {
  const char* const text = ERR_reason_error_string(ERR_peek_last_error());
  ERR_clear_error();
  return text ? text : "no certificate in PEM form";
}

Status UseFile(ssl_ctx_st* context, const std::string& path, const std::string& what) {
  // OpenSSL would wait for the writer of a FIFO.
  if (const Status regular = CheckRegular(path); !regular)
    return Unreadable(what, regular.error().message.substr(path.size() + 2));
  return SSL_CTX_load_verify_file(context, path.c_str()) == 1 ? Status() : Unreadable(what, LastError());
}

}  // namespace

Status UseAuthorities(ssl_ctx_st* context, const HttpOptions& options) {
  if (!options.tls_ca.empty()) return UseFile(context, options.tls_ca, options.tls_ca);
  bool any = false;
  for (const char* variable : {"AWS_CA_BUNDLE", "SSL_CERT_FILE"}) {
    const std::string path = Environment({variable});
    if (path.empty()) continue;
    QUARRY_TRY(UseFile(context, path, fmt::format("{}, which {} names", path, variable)));
    any = true;
  }
  if (any || SSL_CTX_set_default_verify_paths(context) == 1) return {};
  return Unreadable("the system's", LastError());
}

std::string AuthorityAdvice(const HttpOptions& options) {
  return options.ca_option.empty()
             ? "SSL_CERT_FILE names a file of authorities to trust"
             : options.ca_option + " or SSL_CERT_FILE names a file of authorities to trust";
}

}  // namespace quarry
