#include "common/net/security.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <cstdlib>

#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

/// A folder for one test's files, with their modes.
struct Folder : test::TemporaryFolder {
  std::string Write(const std::string& name, const std::string& text, mode_t mode = 0600) const {
    const std::string path = TemporaryFolder::Write(name, text);
    REQUIRE(::chmod(path.c_str(), mode) == 0);
    return path;
  }
};

std::string Text(const Bytes& bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

std::string UsageError(const Result<Security>& result) {
  REQUIRE_FALSE(result.has_value());
  CHECK(result.error().exit_status() == 2);
  return result.error().message;
}

/// Environment variables of one test.
class Environment {
 public:
  ~Environment() {
    for (const SecurityOptionName& name : SecurityOptionNames()) ::unsetenv(name.variable);
  }
  void Set(const char* name, const char* value) { ::setenv(name, value, 1); }
};

}  // namespace

TEST_CASE("A secret is a file's bytes without the newline at its end") {
  const Folder folder;
  const std::string secret = "sixteen bytes ok";
  for (const char* end : {"", "\n", "\r\n"})
    CHECK(Text(*ReadSecret(folder.Write("secret", secret + end))) == secret);
  CHECK(Text(*ReadSecret(folder.Write("secret", secret + "\n\n"))) == secret + "\n");
}

TEST_CASE("Secrets that are short, long, missing or open to others are refused") {
  const Folder folder;
  const auto message = [](const std::string& path) {
    const auto secret = ReadSecret(path);
    REQUIRE_FALSE(secret.has_value());
    CHECK(secret.error().exit_status() == 2);
    return secret.error().message;
  };
  CHECK_THAT(message(folder.Write("short", "fifteen bytes..\n")), Catch::Contains("15 bytes can be guessed"));
  CHECK_THAT(message(folder.Write("empty", "")), Catch::Contains("0 bytes can be guessed"));
  CHECK_THAT(message(folder.Write("long", std::string(70000, 'x'))), Catch::Contains("too large"));
  CHECK_THAT(message("/no/such/secret"), Catch::Contains("/no/such/secret: cannot open: No such file"));
  for (const mode_t mode : {0604, 0640, 0620, 0666})
    CHECK_THAT(message(folder.Write("open", std::string(32, 'x'), mode)), Catch::Contains("chmod 600"));
  CHECK(ReadSecret(folder.Write("closed", std::string(32, 'x'), 0400)).has_value());
}

TEST_CASE("The handshake's key is that of OpenSSL's own HKDF") {
  // openssl kdf -keylen 32 -kdfopt digest:SHA256 -kdfopt key:"correct horse battery staple" -kdfopt
  // salt:quarry
  //   -kdfopt info:"quarry tls13 psk 1" HKDF
  const std::string secret = "correct horse battery staple";
  std::string hex;
  for (const uint8_t byte : DeriveKey(std::as_bytes(std::span(secret)))) hex += fmt::format("{:02x}", byte);
  CHECK(hex == "0003b8ffa1189a1ecfbdc9fca15fbee6ac7759b99246c908749b7b7b239c58b2");
}

TEST_CASE("Security without options is plain") {
  CHECK_FALSE(Security::ForServer({})->tls());
  CHECK_FALSE(Security::ForClient({})->tls());
  CHECK_FALSE(Security().tls());
}

TEST_CASE("Security options that do not fit together are refused with the missing option") {
  const Folder folder;
  const std::string secret = folder.Write("secret", std::string(32, 's'));
  CHECK(Security::ForServer({secret, {}, {}, {}})->tls());
  CHECK(Security::ForClient({secret, {}, {}, {}})->tls());
  CHECK_THAT(UsageError(Security::ForServer({secret, "c", "k", "a"})), Catch::Contains("give one of them"));
  CHECK_THAT(UsageError(Security::ForClient({secret, {}, {}, "a"})), Catch::Contains("give one of them"));
  CHECK_THAT(UsageError(Security::ForServer({{}, "c", {}, "a"})), Catch::Contains("go together"));
  CHECK_THAT(UsageError(Security::ForClient({{}, {}, "k", "a"})), Catch::Contains("go together"));
  CHECK_THAT(UsageError(Security::ForServer({{}, "c", "k", {}})), Catch::Contains("needs --tls-ca"));
  CHECK_THAT(UsageError(Security::ForClient({{}, "c", "k", {}})), Catch::Contains("needs --tls-ca"));
  CHECK_THAT(UsageError(Security::ForServer({{}, {}, {}, "a"})), Catch::Contains("needs --tls-cert"));
}

TEST_CASE("Wrong certificate files are named") {
  const Folder folder;
  const std::string text = folder.Write("text", "no certificate"), open = folder.Write("open", "key", 0604);
  CHECK_THAT(UsageError(Security::ForClient({{}, {}, {}, "/no/such/ca"})),
             Catch::Contains("/no/such/ca: cannot open"));
  CHECK_THAT(UsageError(Security::ForClient({{}, {}, {}, text})),
             Catch::Contains(text + ": no certificates"));
  CHECK_THAT(UsageError(Security::ForServer({{}, text, text, text})),
             Catch::Contains(text + ": not a certificate"));
  CHECK_THAT(UsageError(Security::ForServer({{}, text, open, text})),
             Catch::Contains(open + ": users other than its owner"));
}

TEST_CASE("Security flags beat the environment") {
  Environment environment;
  environment.Set("QUARRY_SECRET_FILE", "env-secret");
  CHECK(WithEnvironment({}) == SecurityOptions{"env-secret", {}, {}, {}});
  CHECK(WithEnvironment({"secret", {}, {}, {}}) == SecurityOptions{"secret", {}, {}, {}});
  CHECK(WithEnvironment({{}, "c", "k", "a"}) == SecurityOptions{{}, "c", "k", "a"});
  environment.Set("QUARRY_TLS_CA", "env-ca");
  CHECK(WithEnvironment({"secret", {}, {}, {}}) == SecurityOptions{"secret", {}, {}, {}});
  CHECK(WithEnvironment({{}, "c", "k", {}}) == SecurityOptions{{}, "c", "k", "env-ca"});
}

}  // namespace quarry
