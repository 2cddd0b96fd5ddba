#pragma once

#include <string>

namespace quarry {

/// A header line of an HTTP request, "name: value".
struct HttpHeader {
  std::string name, value;

  bool operator==(const HttpHeader&) const = default;
};

}  // namespace quarry
