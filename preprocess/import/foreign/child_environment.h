#pragma once

#include <string>
#include <vector>

namespace quarry {

/// Exit status of a program whose shared libraries the loader (ld.so) does not find.
inline constexpr int kNoLibrary = 127;

/// The environment of this process for a child program that must end with it: see EndWithParent().
class ChildEnvironment {
 public:
  ChildEnvironment();
  ChildEnvironment(const ChildEnvironment&) = delete;
  char* const* get() { return variables_.data(); }

 private:
  std::string parent_;
  std::vector<char*> variables_;
};

}  // namespace quarry
