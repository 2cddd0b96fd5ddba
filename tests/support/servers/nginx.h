#pragma once

#include <sys/types.h>

#include <cstdint>
#include <memory>
#include <string>

#include "common/base/status.h"

namespace quarry::test {

/// An nginx process that ends with the object. Its configuration, logs and temporary files are in a folder of
/// its own.
class Nginx {
 public:
  /// The path of the program; empty when it is not installed.
  static std::string Program();

  /// Serves the files of `root` at a free loopback port. `locations`: more lines of the server block.
  /// `certificate`: a PEM file of certificate and key for https; empty for http. `folder`: for files of
  /// nginx.
  static Result<std::unique_ptr<Nginx>> Start(const std::string& folder, const std::string& root,
                                              const std::string& locations = "",
                                              const std::string& certificate = "");
  ~Nginx();
  Nginx(const Nginx&) = delete;
  Nginx& operator=(const Nginx&) = delete;

  uint16_t port() const { return port_; }

 private:
  Nginx() = default;
  pid_t pid_ = -1;
  uint16_t port_ = 0;
};

}  // namespace quarry::test
