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

/// The options that choose the protection of connections. An empty field was not given.
struct SecurityOptions {
  std::string secret_file;                ///< --secret-file: a file with the shared secret
  std::string tls_cert, tls_key, tls_ca;  ///< --tls-cert, --tls-key, --tls-ca: PEM files

  bool operator==(const SecurityOptions&) const = default;
};

/// An option and the environment variable that replaces it.
struct SecurityOptionName {
  std::string SecurityOptions::*field;
  const char *flag, *variable, *help;
};
/// All options with their names, for parsers of command lines.
std::span<const SecurityOptionName> SecurityOptionNames();

/// Fills empty fields from QUARRY_SECRET_FILE, QUARRY_TLS_CERT, QUARRY_TLS_KEY and QUARRY_TLS_CA. A secret on
/// the command line disables the certificates of the environment, and certificates disable its secret.
SecurityOptions WithEnvironment(SecurityOptions options);

/// The protection of connections: none, or TLS 1.3 with proof from both sides. The proof is a shared secret
/// (an external PSK with ephemeral Diffie-Hellman) or certificates. Copies share the loaded files, which
/// ForServer() and ForClient() read once. Thread-safe.
/// Source: RFC 8446, sections 2.2 and 4.2.11 (PSK).
class Security {
 public:
  /// No protection.
  Security() = default;
  /// The protection of an accepting side; none when no option is given.
  /// Errors (usage): secret and certificates together; a certificate without its key or without the authority
  /// for clients' certificates; an authority without a certificate; a file that cannot be read, has the wrong
  /// content, or holds a secret or key that other users may read.
  static Result<Security> ForServer(const SecurityOptions& options);
  /// The protection of a connecting side. As ForServer(), but an authority may stand alone: the client then
  /// checks the server's certificate and shows none.
  static Result<Security> ForClient(const SecurityOptions& options);

  /// Whether connections use TLS.
  bool tls() const { return context_ != nullptr; }
  /// The OpenSSL context for connections; null without protection.
  ssl_ctx_st* context() const { return context_.get(); }

  /// Makes a client's handshake require a certificate for `host`, a name or an address. Call before the
  /// handshake.
  void ExpectHost(ssl_st* connection, const std::string& host) const;
  /// Whether the peer has proved itself. Call after the handshake; false only if OpenSSL breaks its contract.
  bool Proved(ssl_st* connection) const;
  /// Whether the handshake's error `code` means that the peer does not speak TLS.
  static bool IsNotTls(uint64_t code);
  /// The reason of a failed handshake, as text that follows "HOST:PORT ". `code` is from OpenSSL's error
  /// queue.
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

/// Makes a TLS context show the certificates in a PEM file, the program's own first, with the private key in
/// another.
/// Errors (usage): a file that cannot be read or has the wrong content; a key that other users may access,
/// has a password or belongs to another certificate.
Status UseCertificate(ssl_ctx_st* context, const std::string& certificate, const std::string& key);

/// Reads a secret file; the newline at its end is not part of the secret.
/// Errors (usage): cannot be read; other users may read it; shorter than 16 bytes or longer than 64 KiB.
Result<Bytes> ReadSecret(const std::string& path);

/// Derives the PSK of the handshake: HKDF-SHA256 of the secret, salt "quarry", info "quarry tls13 psk 1".
/// All programs must derive the same key: changing it changes the protocol.
/// Source: RFC 5869.
std::array<uint8_t, 32> DeriveKey(std::span<const std::byte> secret);

}  // namespace quarry
