#pragma once

#include <string>
#include <vector>

namespace quarry {

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
