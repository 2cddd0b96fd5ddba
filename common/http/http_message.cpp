#include "common/http/http_message.h"

#include <algorithm>

namespace quarry {
namespace {

bool HasControl(std::string_view text) {
  return std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; });
}

}  // namespace

std::string LowerCase(std::string_view text) {
  std::string lower(text);
  for (char& c : lower)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return lower;
}

std::string HttpRequest::header(const std::string& name) const {
  std::string value;
  bool found = false;
  for (const auto& [its_name, its_value] : headers) {
    if (its_name != name) continue;
    if (std::exchange(found, true)) value += ", ";
    value += its_value;
  }
  return value;
}

bool SplitTarget(std::string_view target, HttpRequest& request) {
  if (target.empty() || target.front() != '/') return false;
  const size_t mark = target.find('?');
  request.path = target.substr(0, mark);
  request.query = mark == std::string_view::npos ? "" : target.substr(mark + 1);
  return true;
}

std::vector<std::pair<std::string, std::string>> AnswerHeaders(HttpResponse& answer) {
  bool good = !HasControl(answer.content_type);
  for (const auto& [name, value] : answer.headers)
    good = good && !name.empty() && !HasControl(name) && !HasControl(value);
  // The text may come from a request: unchanged, it could end the headers and begin another answer.
  if (!good) answer = {500, "text/plain; charset=utf-8", "the answer had a line end in a header\n", {}};
  std::vector<std::pair<std::string, std::string>> headers{{"Content-Type", answer.content_type},
                                                           {"X-Content-Type-Options", "nosniff"},
                                                           {"Cache-Control", "no-store"}};
  for (const auto& header : answer.headers) {
    std::erase_if(headers, [&](const auto& own) {
      return own.first != "Content-Type" && LowerCase(own.first) == LowerCase(header.first);
    });
  }
  headers.insert(headers.end(), answer.headers.begin(), answer.headers.end());
  return headers;
}

}  // namespace quarry
