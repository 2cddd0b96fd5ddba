#pragma once

#include <string>

namespace quarry {

/// One line of an HTTP request's head, "name: value".
struct HttpHeader {
  std::string name, value;

  bool operator==(const HttpHeader&) const = default;
};

}  // namespace quarry
