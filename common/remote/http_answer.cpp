#include "common/remote/http_answer.h"

#include <fmt/format.h>

#include <boost/beast/http/status.hpp>
#include <charconv>

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

std::string StatusSentence(unsigned status) {
  const auto reason = boost::beast::http::obsolete_reason(static_cast<boost::beast::http::status>(status));
  std::string answer = fmt::format("answers {} {}", status, std::string(reason.data(), reason.size()));
  if (status == 200) return "does not serve ranges: it answers with the whole file";
  if (status == 416) return answer + ": the file is shorter than the scene's store";
  if (status == 401 || status == 403) return answer + ": credentials are missing, or are not the right ones";
  if (status >= 300 && status < 400)
    return answer + ": redirections are not followed, give the final address";
  return answer;
}

}  // namespace quarry
