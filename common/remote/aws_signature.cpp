#include "common/remote/aws_signature.h"

#include <fmt/format.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <span>
#include <string_view>
#include <utility>

#include "common/base/check.h"

namespace quarry {
namespace {

constexpr std::string_view kAlgorithm = "AWS4-HMAC-SHA256";
using Digest = std::array<unsigned char, 32>;

std::string Hex(const Digest& digest) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string text;
  for (const unsigned char c : digest) {
    text += kDigits[c >> 4];
    text += kDigits[c & 15];
  }
  return text;
}

Digest Sha256(std::string_view text) {
  Digest digest;
  QUARRY_CHECK(EVP_Digest(text.data(), text.size(), digest.data(), nullptr, EVP_sha256(), nullptr) == 1);
  return digest;
}

Digest Hmac(std::span<const unsigned char> key, std::string_view text) {
  Digest digest;
  QUARRY_CHECK(HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()),
                    reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data(),
                    nullptr) != nullptr);
  return digest;
}

int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  const char lower = static_cast<char>(c | 0x20);
  return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

/// Percent-encodes text in the one form that signatures use. Text that is already encoded is decoded first.
std::string Canonical(std::string_view encoded, bool keep_slashes) {
  std::string out;
  for (size_t i = 0; i < encoded.size(); ++i) {
    auto c = static_cast<unsigned char>(encoded[i]);
    if (c == '%' && i + 2 < encoded.size() && HexDigit(encoded[i + 1]) >= 0 &&
        HexDigit(encoded[i + 2]) >= 0) {
      c = static_cast<unsigned char>(HexDigit(encoded[i + 1]) * 16 + HexDigit(encoded[i + 2]));
      i += 2;
    }
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                       c == '-' || c == '.' || c == '_' || c == '~' || (c == '/' && keep_slashes);
    if (plain)
      out += static_cast<char>(c);
    else
      out += fmt::format("%{:02X}", c);
  }
  return out;
}

std::string CanonicalQuery(std::string_view query) {
  std::vector<std::pair<std::string, std::string>> parameters;
  while (!query.empty()) {
    const std::string_view one = query.substr(0, query.find('&'));
    query.remove_prefix(std::min(query.size(), one.size() + 1));
    if (one.empty()) continue;
    const size_t equals = std::min(one.find('='), one.size());
    parameters.emplace_back(Canonical(one.substr(0, equals), false),
                            Canonical(one.substr(std::min(equals + 1, one.size())), false));
  }
  std::ranges::sort(parameters);
  std::string text;
  for (const auto& [name, value] : parameters)
    text += fmt::format("{}{}={}", text.empty() ? "" : "&", name, value);
  return text;
}

/// Removes spaces at both ends and joins runs of spaces to one.
std::string CanonicalValue(std::string_view value) {
  std::string text;
  for (const char c : value)
    if ((c != ' ' && c != '\t') || (!text.empty() && text.back() != ' ')) text += c == '\t' ? ' ' : c;
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return text;
}

struct Canon {
  std::string request, signed_headers;
};
Canon CanonicalRequest(const AwsRequest& request, std::vector<HttpHeader> headers,
                       const std::string& content_hash) {
  for (HttpHeader& h : headers)
    std::ranges::transform(h.name, h.name.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  std::ranges::sort(headers, {}, &HttpHeader::name);
  Canon canon;
  std::string lines;
  for (const HttpHeader& h : headers) {
    lines += fmt::format("{}:{}\n", h.name, CanonicalValue(h.value));
    canon.signed_headers += fmt::format("{}{}", canon.signed_headers.empty() ? "" : ";", h.name);
  }
  const std::string_view target = request.target;
  const size_t question = std::min(target.find('?'), target.size());
  const std::string_view query = target.substr(std::min(question + 1, target.size()));
  canon.request = fmt::format("GET\n{}\n{}\n{}\n{}\n{}", Canonical(target.substr(0, question), true),
                              CanonicalQuery(query), lines, canon.signed_headers, content_hash);
  return canon;
}

}  // namespace

std::vector<HttpHeader> SignAwsRequest(const AwsRequest& request, const AwsCredentials& credentials,
                                       std::time_t now) {
  std::tm utc{};
  QUARRY_CHECK(::gmtime_r(&now, &utc) != nullptr);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y%m%dT%H%M%SZ", &utc);
  const std::string date(text.data()), day = date.substr(0, 8);
  const std::string empty_body = Hex(Sha256(""));

  std::vector<HttpHeader> added = {{"x-amz-content-sha256", empty_body}, {"x-amz-date", date}};
  if (!credentials.session_token.empty())
    added.push_back({"x-amz-security-token", credentials.session_token});
  std::vector<HttpHeader> all = request.headers;
  all.push_back({"host", request.host});
  all.insert(all.end(), added.begin(), added.end());
  const Canon canon = CanonicalRequest(request, std::move(all), empty_body);

  const std::string scope = fmt::format("{}/{}/s3/aws4_request", day, credentials.region);
  const std::string to_sign =
      fmt::format("{}\n{}\n{}\n{}", kAlgorithm, date, scope, Hex(Sha256(canon.request)));
  const std::string first = "AWS4" + credentials.secret_key;
  Digest key = Hmac({reinterpret_cast<const unsigned char*>(first.data()), first.size()}, day);
  for (const std::string_view part :
       {std::string_view(credentials.region), std::string_view("s3"), std::string_view("aws4_request")})
    key = Hmac(key, part);
  added.push_back({"Authorization", fmt::format("{} Credential={}/{},SignedHeaders={},Signature={}",
                                                kAlgorithm, credentials.access_key, scope,
                                                canon.signed_headers, Hex(Hmac(key, to_sign)))});
  return added;
}

}  // namespace quarry
