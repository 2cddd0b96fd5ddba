#include "common/remote/http_answer.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/beast/http/status.hpp>
#include <charconv>
#include <utility>

#include "common/remote/environment.h"

namespace quarry {
namespace {

bool TakeNumber(std::string_view& text, uint64_t& number) {
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{}) return false;
  text.remove_prefix(static_cast<size_t>(rest - text.data()));
  return true;
}

}  // namespace

std::optional<ContentRange> DecodeContentRange(std::string_view text) {
  ContentRange range;
  if (!text.starts_with("bytes ")) return std::nullopt;
  text.remove_prefix(6);
  if (!TakeNumber(text, range.first) || !text.starts_with('-')) return std::nullopt;
  text.remove_prefix(1);
  if (!TakeNumber(text, range.last) || !text.starts_with('/')) return std::nullopt;
  text.remove_prefix(1);
  if (text == "*") return range;
  if (!TakeNumber(text, range.file_size) || !text.empty()) return std::nullopt;
  return range.last < range.file_size ? std::optional(range) : std::nullopt;
}

bool IsPermanentStatus(unsigned status) {
  return status < 500 && status != 408 && status != 425 && status != 429;
}

namespace {

/// The advice behind a refusal: the option or variable that helps.
std::string_view AdviceFor(unsigned status, std::string_view code) {
  struct Known {
    std::string_view code, advice;
  };
  constexpr Known kKnown[] = {
      {"ExpiredToken", "the credentials have expired; get new ones"},
      {"ExpiredTokenException", "the credentials have expired; get new ones"},
      {"TokenRefreshRequired", "the credentials have expired; get new ones"},
      {"InvalidToken", "the session token is wrong"},
      {"InvalidAccessKeyId", "the server does not know this access key"},
      {"SignatureDoesNotMatch", "the secret key or the region is wrong"},
      {"AuthorizationHeaderMalformed", "the region is wrong; set AWS_REGION"},
      {"PermanentRedirect", "the bucket is in another region; set AWS_REGION"},
      {"RequestTimeTooSkewed", "this machine's clock is wrong"},
      {"RequestExpired", "the signed address has expired; get a new one"},
      {"NoSuchBucket", "there is no such bucket"},
      {"NoSuchKey", "there is no such file"},
  };
  for (const Known& known : kKnown)
    if (known.code == code) return known.advice;
  if (status == 416) return "the file is shorter than the scene's store";
  if (status == 401 || status == 403) return "credentials are missing or wrong";
  if (status == 407) return "the proxy requires a user and password: http://USER:PASSWORD@HOST:PORT";
  if (IsRedirection(status)) return "it does not say where the file is";
  return {};
}

}  // namespace

std::string CodeOf(std::string_view body) {
  constexpr size_t kMostCode = 64;
  const auto after = [&](std::string_view mark) {
    const size_t at = body.find(mark);
    return at == std::string_view::npos ? std::string_view() : body.substr(at + mark.size());
  };
  std::string_view rest = after("<Code>");
  if (rest.empty()) {
    rest = after("\"code\"");
    rest.remove_prefix(std::min(rest.find_first_not_of(" \t\r\n:\""), rest.size()));
  }
  const size_t end =
      std::min(rest.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-"),
               rest.size());
  return end > 0 && end <= kMostCode && end < rest.size() && (rest[end] == '<' || rest[end] == '"')
             ? std::string(rest.substr(0, end))
             : std::string();
}

std::string StatusSentence(unsigned status, const std::string& code) {
  if (status == 200) return "does not serve ranges: it answers with the whole file";
  const auto reason = boost::beast::http::obsolete_reason(static_cast<boost::beast::http::status>(status));
  std::string answer = fmt::format("answers {} {}", status, std::string(reason.data(), reason.size()));
  if (!code.empty()) answer += fmt::format(" ({})", code);
  const std::string_view advice = AdviceFor(status, code);
  return advice.empty() ? answer : fmt::format("{}: {}", answer, advice);
}

bool IsRedirection(unsigned status) {
  return status == 301 || status == 302 || status == 303 || status == 307 || status == 308;
}

Result<HttpLocation> RedirectedTo(const HttpLocation& from, std::string_view target) {
  const auto refuse = [](std::string why) {
    return tl::unexpected<Error>(Error{std::move(why), ErrorKind::kPermanent});
  };
  std::string address(target.substr(0, target.find('#')));
  if (address.empty()) return refuse("redirects without an address");
  if (address.starts_with("//")) {
    address = (from.tls ? "https:" : "http:") + address;
  } else if (address.starts_with('/') || address.starts_with('?') ||
             address.find("://") == std::string::npos) {
    const std::string path = from.target.substr(0, from.target.find('?'));
    const std::string before = address.starts_with('/')   ? ""
                               : address.starts_with('?') ? path
                                                          : path.substr(0, path.rfind('/') + 1);
    address = fmt::format("{}://{}{}{}", from.tls ? "https" : "http", from.authority(), before, address);
  }
  Result<HttpLocation> location = ParseHttpLocation(address, "the address that it redirects to");
  if (!location) return refuse(location.error().message);
  if (from.tls && !location->tls)
    return refuse(fmt::format("redirects from https to {}, which others could read", location->text()));
  return location;
}

bool SameServer(const HttpLocation& a, const HttpLocation& b) {
  return a.tls == b.tls && a.port == b.port && Lower(a.host) == Lower(b.host);
}

}  // namespace quarry
