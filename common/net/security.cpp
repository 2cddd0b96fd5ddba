#include "common/net/security.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/core_names.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/kdf.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "common/base/check.h"
#include "common/base/descriptor.h"

namespace quarry {
namespace {

constexpr size_t kLeastSecret = 16,
                 kMostSecret = 64 << 10;  // bytes: too short to resist guessing; too large to be a secret
constexpr std::string_view kIdentity = "quarry";
// The PSK is bound to SHA-256, so the cipher suite must use SHA-256 too.
constexpr const char* kCipherName = "TLS_AES_128_GCM_SHA256";
constexpr unsigned char kCipherId[2] = {0x13, 0x01};

constexpr SecurityOptionName kNames[] = {
    {&SecurityOptions::secret_file, "--secret-file", "QUARRY_SECRET_FILE",
     "TLS by a shared secret: the file that holds it"},
    {&SecurityOptions::tls_cert, "--tls-cert", "QUARRY_TLS_CERT",
     "TLS by certificates: this program's certificate (PEM)"},
    {&SecurityOptions::tls_key, "--tls-key", "QUARRY_TLS_KEY", "The private key of --tls-cert (PEM)"},
    {&SecurityOptions::tls_ca, "--tls-ca", "QUARRY_TLS_CA",
     "The authority that signed the other side's certificate (PEM)"},
};

struct Key {
  std::array<uint8_t, 32> bytes;
  ~Key() { OPENSSL_cleanse(bytes.data(), bytes.size()); }
};

void FreeKey(void*, void* key, CRYPTO_EX_DATA*, int, long, void*) { delete static_cast<Key*>(key); }

/// The slot for the Key in an SSL_CTX. Slot 0 belongs to Asio.
int KeyIndex() {
  static const int index = SSL_CTX_get_ex_new_index(0, nullptr, nullptr, nullptr, FreeKey);
  return index;
}

/// A session that carries the secret as its PSK; null when out of memory.
SSL_SESSION* SecretSession(SSL* connection) {
  const auto* key = static_cast<const Key*>(SSL_CTX_get_ex_data(SSL_get_SSL_CTX(connection), KeyIndex()));
  SSL_SESSION* session = SSL_SESSION_new();
  if (session && SSL_SESSION_set1_master_key(session, key->bytes.data(), key->bytes.size()) &&
      SSL_SESSION_set_cipher(session, SSL_CIPHER_find(connection, kCipherId)) &&
      SSL_SESSION_set_protocol_version(session, TLS1_3_VERSION))
    return session;
  SSL_SESSION_free(session);
  return nullptr;
}

int OfferSecret(SSL* connection, const EVP_MD* digest, const unsigned char** identity, size_t* size,
                SSL_SESSION** session) {
  *session = nullptr;
  if (digest && !EVP_MD_is_a(digest, "SHA256")) return 1;  // the server wants another hash: no PSK to offer
  *identity = reinterpret_cast<const unsigned char*>(kIdentity.data());
  *size = kIdentity.size();
  *session = SecretSession(connection);
  return *session ? 1 : 0;
}

int FindSecret(SSL* connection, const unsigned char* identity, size_t size, SSL_SESSION** session) {
  *session = nullptr;
  if (std::string_view(reinterpret_cast<const char*>(identity), size) != kIdentity) return 1;
  *session = SecretSession(connection);
  return *session ? 1 : 0;
}

int BelieveNoCertificate(X509_STORE_CTX* chain, void*) {
  X509_STORE_CTX_set_error(chain, X509_V_ERR_APPLICATION_VERIFICATION);
  return 0;
}

std::string ReasonText(uint64_t code) {
  const char* text = ERR_reason_error_string(static_cast<unsigned long>(code));
  return text ? text : fmt::format("OpenSSL's error {:x}", code);
}

/// The text of the newest error in OpenSSL's queue. Empties the queue.
std::string LastError() {
  const unsigned long code = ERR_peek_last_error();
  ERR_clear_error();
  return ReasonText(code);
}

Status UseSecret(SSL_CTX* context, const std::string& path, bool server) {
  QUARRY_ASSIGN(const Bytes secret, ReadSecret(path));
  SSL_CTX_set_ex_data(context, KeyIndex(), new Key{DeriveKey(secret)});
  if (server) {
    SSL_CTX_set_psk_find_session_callback(context, FindSecret);
  } else {
    SSL_CTX_set_psk_use_session_callback(context, OfferSecret);
    // Refuses all certificates: otherwise a server without the secret could present any certificate instead.
    SSL_CTX_set_verify(context, SSL_VERIFY_PEER, nullptr);
    SSL_CTX_set_cert_verify_callback(context, BelieveNoCertificate, nullptr);
  }
  return {};
}

/// Whether others than the owner may use a file of secrets.
/// systemd's credentials (LoadCredential=) belong to root, and an access list lets the service's user read
/// them. The list shows as permission of the group, which the group does not have.
bool OthersMayUse(const std::string& path, mode_t mode) {
  const char* const folder = std::getenv("CREDENTIALS_DIRECTORY");
  const bool credential = folder && path.starts_with(std::string(folder) + '/');
  return (mode & (credential ? 037 : 077)) != 0;
}

/// Errors: missing; not readable by this process; not a regular file; a key that other users may access.
Status CheckReadable(const std::string& path, bool key) {
  // O_NONBLOCK: opening a FIFO would otherwise wait for a writer, perhaps forever.
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return BadUsage(fmt::format("{}: cannot open: {}", path, ErrnoText(errno)));
  struct stat info {};
  const bool regular = ::fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
  ::close(fd);
  if (!regular) return BadUsage(fmt::format("{}: is not a regular file", path));
  if (key && OthersMayUse(path, info.st_mode))
    return BadUsage(
        fmt::format("{}: users other than its owner may use this private key; chmod 600 it", path));
  if (key && StrangerOwns(info)) return BadUsage(StrangerSentence(path, info));
  return {};
}

Status UseCertificates(SSL_CTX* context, const SecurityOptions& o, bool server) {
  if (!o.tls_cert.empty()) QUARRY_TRY(UseCertificate(context, o.tls_cert, o.tls_key));
  QUARRY_TRY(CheckReadable(o.tls_ca, false));
  if (SSL_CTX_load_verify_file(context, o.tls_ca.c_str()) != 1)
    return BadUsage(fmt::format("{}: no certificates in PEM form: {}", o.tls_ca, LastError()));
  SSL_CTX_set_verify(context, SSL_VERIFY_PEER | (server ? SSL_VERIFY_FAIL_IF_NO_PEER_CERT : 0), nullptr);
  return {};
}

/// Errors: options that contradict or need one another.
Status CheckTogether(const SecurityOptions& o, bool server) {
  const bool secret = !o.secret_file.empty(), certificate = !o.tls_cert.empty(), key = !o.tls_key.empty(),
             authority = !o.tls_ca.empty();
  if (secret && (certificate || key || authority))
    return BadUsage(
        "--secret-file and certificates (--tls-cert, --tls-key, --tls-ca) cannot be used together; give one "
        "of them");
  if (certificate != key)
    return BadUsage("--tls-cert and --tls-key go together: a certificate and its private key");
  if (certificate && !authority)
    return BadUsage(
        server ? "--tls-cert needs --tls-ca too: the authority that must have signed the "
                 "certificates of workers and clients, or anybody could join"
               : "--tls-cert needs --tls-ca too: the authority that signed the master's certificate");
  if (server && authority && !certificate)
    return BadUsage("--tls-ca needs --tls-cert and --tls-key too: a server shows a certificate of its own");
  return {};
}

bool Among(int reason, std::initializer_list<int> reasons) {
  for (const int r : reasons)
    if (r == reason) return true;
  return false;
}

/// The TLS alert that the peer sent, or -1.
int AlertOf(int reason) {
  return reason >= SSL_AD_REASON_OFFSET && reason < SSL_AD_REASON_OFFSET + 256 ? reason - SSL_AD_REASON_OFFSET
                                                                               : -1;
}

bool IsAboutCertificate(int alert) {
  return Among(alert, {SSL_AD_BAD_CERTIFICATE, SSL_AD_UNSUPPORTED_CERTIFICATE, SSL_AD_CERTIFICATE_REVOKED,
                       SSL_AD_CERTIFICATE_EXPIRED, SSL_AD_CERTIFICATE_UNKNOWN, SSL_AD_UNKNOWN_CA});
}

std::string CertificateText(SSL* connection) {
  return fmt::format("shows a certificate that does not fit: {}",
                     X509_verify_cert_error_string(SSL_get_verify_result(connection)));
}

}  // namespace

std::span<const SecurityOptionName> SecurityOptionNames() { return kNames; }

SecurityOptions WithEnvironment(SecurityOptions options) {
  const bool secret = !options.secret_file.empty();
  const bool certificates = !(options.tls_cert + options.tls_key + options.tls_ca).empty();
  for (const SecurityOptionName& name : kNames) {
    const bool of_secret = name.field == &SecurityOptions::secret_file;
    if (of_secret ? certificates : secret) continue;
    const char* value = std::getenv(name.variable);
    if (value && (options.*name.field).empty()) options.*name.field = value;
  }
  return options;
}

Status UseCertificate(SSL_CTX* context, const std::string& certificate, const std::string& key) {
  QUARRY_TRY(CheckReadable(certificate, false));
  QUARRY_TRY(CheckReadable(key, true));
  // The callback fails, so that OpenSSL never asks for a key's password at the terminal.
  SSL_CTX_set_default_passwd_cb(context, [](char*, int, int, void*) { return -1; });
  if (SSL_CTX_use_certificate_chain_file(context, certificate.c_str()) != 1)
    return BadUsage(fmt::format("{}: not a certificate in PEM form: {}", certificate, LastError()));
  if (SSL_CTX_use_PrivateKey_file(context, key.c_str(), SSL_FILETYPE_PEM) != 1)
    return BadUsage(fmt::format("{}: not a private key in PEM form without a password, or not {}'s: {}", key,
                                certificate, LastError()));
  return {};
}

Result<Bytes> ReadSecret(const std::string& path) {
  // The secret may come through a shell's pipe; opening a FIFO without a writer must not block.
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd >= 0) ::fcntl(fd, F_SETFL, ::fcntl(fd, F_GETFL) & ~O_NONBLOCK);
  std::FILE* const file = fd >= 0 ? ::fdopen(fd, "r") : nullptr;
  if (!file) return BadUsage(fmt::format("{}: cannot open: {}", path, ErrnoText(errno)));
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> closer(file, std::fclose);
  struct stat info {};
  if (::fstat(fd, &info) != 0) return BadUsage(fmt::format("{}: cannot examine: {}", path, ErrnoText(errno)));
  if (OthersMayUse(path, info.st_mode))
    return BadUsage(fmt::format("{}: users other than its owner may read this secret; chmod 600 it", path));
  if (StrangerOwns(info)) return BadUsage(StrangerSentence(path, info));
  Bytes secret(kMostSecret + 1);
  secret.resize(std::fread(secret.data(), 1, secret.size(), file));
  if (std::ferror(file)) return BadUsage(fmt::format("{}: cannot read: {}", path, ErrnoText(errno)));
  if (secret.size() > kMostSecret) return BadUsage(fmt::format("{}: too large for a secret", path));
  for (const char end : {'\n', '\r'})
    if (!secret.empty() && secret.back() == static_cast<std::byte>(end)) secret.pop_back();
  if (secret.size() < kLeastSecret)
    return BadUsage(
        fmt::format("{}: a secret of {} bytes can be guessed; make one of at least {} with "
                    "'openssl rand -hex 32'",
                    path, secret.size(), kLeastSecret));
  return secret;
}

std::array<uint8_t, 32> DeriveKey(std::span<const std::byte> secret) {
  const std::unique_ptr<EVP_KDF, void (*)(EVP_KDF*)> kdf(EVP_KDF_fetch(nullptr, "HKDF", nullptr),
                                                         EVP_KDF_free);
  const std::unique_ptr<EVP_KDF_CTX, void (*)(EVP_KDF_CTX*)> context(EVP_KDF_CTX_new(kdf.get()),
                                                                     EVP_KDF_CTX_free);
  char digest[] = "SHA256", salt[] = "quarry", info[] = "quarry tls13 psk 1";
  const OSSL_PARAM parameters[] = {
      OSSL_PARAM_construct_utf8_string(OSSL_KDF_PARAM_DIGEST, digest, 0),
      OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_KEY, const_cast<std::byte*>(secret.data()),
                                        secret.size()),
      OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_SALT, salt, std::strlen(salt)),
      OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_INFO, info, std::strlen(info)),
      OSSL_PARAM_construct_end(),
  };
  std::array<uint8_t, 32> key{};
  QUARRY_CHECK(EVP_KDF_derive(context.get(), key.data(), key.size(), parameters) == 1);
  return key;
}

Result<Security> Security::ForServer(const SecurityOptions& options) { return Make(options, true); }
Result<Security> Security::ForClient(const SecurityOptions& options) { return Make(options, false); }

Result<Security> Security::Make(const SecurityOptions& options, bool server) {
  Security security;
  security.server_ = server;
  if (options == SecurityOptions{}) return security;
  QUARRY_TRY(CheckTogether(options, server));
  security.context_.reset(SSL_CTX_new(server ? TLS_server_method() : TLS_client_method()), SSL_CTX_free);
  SSL_CTX* context = security.context_.get();
  if (!context) return Fail(fmt::format("OpenSSL cannot be used: {}", LastError()));
  SSL_CTX_set_min_proto_version(context, TLS1_3_VERSION);
  SSL_CTX_set_max_proto_version(context, TLS1_3_VERSION);
  if (SSL_CTX_set_ciphersuites(context, kCipherName) != 1)
    return Fail(fmt::format("this OpenSSL does not have {}: {}", kCipherName, LastError()));
  // Each connection proves itself anew: no tickets, no session cache, no early data.
  SSL_CTX_set_options(context, SSL_OP_NO_TICKET);
  SSL_CTX_set_num_tickets(context, 0);
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_max_early_data(context, 0);
  security.proof_ = options.secret_file.empty() ? Proof::kCertificate : Proof::kSecret;
  if (security.proof_ == Proof::kSecret) {
    QUARRY_TRY(UseSecret(context, options.secret_file, server));
  } else {
    QUARRY_TRY(UseCertificates(context, options, server));
  }
  return security;
}

void Security::ExpectHost(ssl_st* connection, const std::string& host) const {
  if (proof_ == Proof::kSecret) return;
  X509_VERIFY_PARAM* expected = SSL_get0_param(connection);
  if (X509_VERIFY_PARAM_set1_ip_asc(expected, host.c_str()) == 1) return;
  X509_VERIFY_PARAM_set_hostflags(expected, X509_CHECK_FLAG_NO_PARTIAL_WILDCARDS);
  QUARRY_CHECK(X509_VERIFY_PARAM_set1_host(expected, host.c_str(), host.size()) == 1);
  SSL_set_tlsext_host_name(connection, host.c_str());
}

bool Security::Proved(ssl_st* connection) const {
  if (SSL_version(connection) != TLS1_3_VERSION) return false;
  if (proof_ == Proof::kSecret) return SSL_session_reused(connection) == 1;
  return SSL_get0_peer_certificate(connection) && SSL_get_verify_result(connection) == X509_V_OK;
}

bool Security::IsNotTls(uint64_t code) {
  return Among(ERR_GET_REASON(static_cast<unsigned long>(code)),
               {SSL_R_WRONG_VERSION_NUMBER, SSL_R_HTTP_REQUEST, SSL_R_HTTPS_PROXY_REQUEST});
}

std::string Security::Explain(ssl_st* connection, uint64_t code) const {
  const int reason = ERR_GET_REASON(static_cast<unsigned long>(code));
  std::string text = server_ ? ExplainToServer(connection, code) : ExplainToClient(connection, code);
  if (!text.empty()) return text;
  return fmt::format("{} the TLS handshake: {}", AlertOf(reason) < 0 ? "broke" : "refused", ReasonText(code));
}

std::string Security::ExplainToServer(ssl_st* connection, uint64_t code) const {
  const int reason = ERR_GET_REASON(static_cast<unsigned long>(code));
  if (IsNotTls(code))
    return proof_ == Proof::kSecret ? "does not speak TLS; give it this side's --secret-file"
                                    : "does not speak TLS; give it --tls-ca, --tls-cert and --tls-key";
  if (reason == SSL_R_UNSUPPORTED_PROTOCOL) return "does not speak TLS 1.3";
  if (proof_ == Proof::kSecret) {
    if (reason == SSL_R_BINDER_DOES_NOT_VERIFY)
      return "has another secret; give it this side's --secret-file";
    if (Among(reason,
              {SSL_R_NO_SUITABLE_SIGNATURE_ALGORITHM, SSL_R_NO_SHARED_CIPHER, SSL_R_NO_SUITABLE_KEY_SHARE}))
      return "speaks TLS without the secret; give it this side's --secret-file";
    return {};
  }
  if (reason == SSL_R_PEER_DID_NOT_RETURN_A_CERTIFICATE)
    return "shows no certificate; give it --tls-cert and --tls-key";
  if (reason == SSL_R_CERTIFICATE_VERIFY_FAILED) return CertificateText(connection);
  if (const int alert = AlertOf(reason); IsAboutCertificate(alert) || alert == SSL_AD_DECRYPT_ERROR)
    return fmt::format("does not take this side's certificate ({})", SSL_alert_desc_string_long(alert));
  return {};
}

std::string Security::ExplainToClient(ssl_st* connection, uint64_t code) const {
  const int reason = ERR_GET_REASON(static_cast<unsigned long>(code));
  if (IsNotTls(code))
    return proof_ == Proof::kSecret
               ? "does not speak TLS; start it with --secret-file too, or leave it out here"
               : "does not speak TLS; start it with --tls-cert, --tls-key and --tls-ca, or leave them out "
                 "here";
  const int alert = AlertOf(reason);
  if (reason == SSL_R_UNSUPPORTED_PROTOCOL || alert == SSL_AD_PROTOCOL_VERSION)
    return "does not speak TLS 1.3";
  if (proof_ == Proof::kSecret) {
    if (reason == SSL_R_CERTIFICATE_VERIFY_FAILED)
      return "uses certificates instead of a secret; give --tls-ca, and --tls-cert and --tls-key if it "
             "requires them";
    if (alert >= 0) return "does not take this side's secret; give both the same --secret-file";
    return {};
  }
  if (reason == SSL_R_CERTIFICATE_VERIFY_FAILED) return CertificateText(connection);
  if (alert == SSL_AD_CERTIFICATE_REQUIRED) return "asks for a certificate; give --tls-cert and --tls-key";
  if (IsAboutCertificate(alert))
    return fmt::format("does not take this side's certificate ({})", SSL_alert_desc_string_long(alert));
  if (alert == SSL_AD_HANDSHAKE_FAILURE)
    return "has no certificate to show; give --secret-file if it was started with one";
  return {};
}

}  // namespace quarry
