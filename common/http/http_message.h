#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/http/http_server.h"

// Helpers for the text of requests and answers.

namespace quarry {

/// Fills path and query from a request's target. Returns: whether it is a path ("/stats?a=b").
bool SplitTarget(std::string_view target, HttpRequest& request);

/// ASCII letters in lower case.
std::string LowerCase(std::string_view text);

/// All headers of an answer except Content-Length and Connection. A header of the answer replaces a default
/// header of the same name. An answer that has a control character in a header is replaced first.
std::vector<std::pair<std::string, std::string>> AnswerHeaders(HttpResponse& answer);

}  // namespace quarry
