#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"

struct ssl_ctx_st;
struct ssl_st;

namespace quarry {

/// The options that decide how connections are protected, as given; empty: not given.
struct SecurityOptions {
  std::string secret_file;                ///< --secret-file: both sides know what is in it
  std::string tls_cert, tls_key, tls_ca;  ///< --tls-cert, --tls-key, --tls-ca: PEM files

  bool operator==(const SecurityOptions&) const = default;
};

/// Each option with the variable that stands in for it.
struct SecurityOptionName {
  std::string SecurityOptions::*field;
  const char *flag, *variable, *help;
};
std::span<const SecurityOptionName> SecurityOptionNames();

/// Fills what was not given from QUARRY_SECRET_FILE, QUARRY_TLS_CERT, QUARRY_TLS_KEY and QUARRY_TLS_CA. A
/// secret given on the command line keeps certificates of the environment out, and the reverse.
SecurityOptions WithEnvironment(SecurityOptions options);

/// How connections are protected: plain, or TLS 1.3 in which both sides prove themselves, by a shared secret
/// (an external PSK, with ephemeral Diffie-Hellman) or by certificates. A value: copies share what was read.
/// Thread-safe; the files are read once, by ForServer and ForClient.
class Security {
 public:
  /// Plain.
  Security() = default;
  /// Plain when no option is given. Errors (usage): secret and certificates at once; a certificate without
  /// its key or without the authority that clients' certificates must come from; a file that cannot be read,
  /// is not what it should be, or that others may read.
  static Result<Security> ForServer(const SecurityOptions& options);
  /// As ForServer, but an authority may stand alone: the server's certificate is checked, none is shown.
  static Result<Security> ForClient(const SecurityOptions& options);

  bool tls() const { return context_ != nullptr; }
  /// The OpenSSL context that connections are made from; null: plain.
  ssl_ctx_st* context() const { return context_.get(); }

  /// Before a client's handshake: the certificate must be one for `host`, a name or an address.
  void ExpectHost(ssl_st* connection, const std::string& host) const;
  /// After a handshake: whether the other side has proved itself. It has, or OpenSSL does not do what it
  /// says.
  bool Proved(ssl_st* connection) const;
  /// Whether a handshake with this error met first bytes that are no TLS.
  static bool IsNotTls(uint64_t code);
  /// Why a handshake has failed, as what follows "HOST:PORT ". `code` is OpenSSL's, as its queue of errors
  /// had it.
  std::string Explain(ssl_st* connection, uint64_t code) const;

 private:
  enum class Proof { kSecret, kCertificate };
  static Result<Security> Make(const SecurityOptions& options, bool server);
  std::string ExplainToServer(ssl_st* connection, uint64_t code) const;
  std::string ExplainToClient(ssl_st* connection, uint64_t code) const;

  std::shared_ptr<ssl_ctx_st> context_;
  Proof proof_ = Proof::kSecret;
  bool server_ = false;
};

/// A secret file's bytes without the newline at its end. Errors (usage): cannot be read, may be read by
/// others than its owner, holds less than 16 bytes or more than 64 KiB.
Result<Bytes> ReadSecret(const std::string& path);

/// The key of the handshake: HKDF-SHA256 of the secret, salt "quarry", info "quarry tls13 psk 1".
/// All programs must derive the same: a change of it is a change of the protocol.
std::array<uint8_t, 32> DeriveKey(std::span<const std::byte> secret);

}  // namespace quarry
