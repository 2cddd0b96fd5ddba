#pragma once

#include <sys/types.h>

#include <cstdint>
#include <memory>
#include <string>

#include "common/base/status.h"

namespace quarry::test {

/// An nginx of this process's own, with its configuration, logs and temporaries in a folder of its own; ends
/// with the object.
class Nginx {
 public:
  /// The program, or empty where it is not installed.
  static std::string Program();

  /// Serves the files of `root` at a free loopback port, `locations` being further lines of the server block
  /// and `certificate` a PEM file of certificate and key, for https; empty: http. `folder` is its own.
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
