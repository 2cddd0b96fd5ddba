#pragma once

#include <string>
#include <vector>

namespace quarry {

/// This process's environment for a program started by it alone, which ends with it: see EndWithParent.
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
