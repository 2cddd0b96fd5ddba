#include "preprocess/import/foreign/child_environment.h"

#include <unistd.h>

#include <string_view>

extern char** environ;

namespace quarry {

ChildEnvironment::ChildEnvironment() : parent_("QUARRY_PARENT=" + std::to_string(::getpid())) {
  for (char** variable = environ; *variable; ++variable)
    if (!std::string_view(*variable).starts_with("QUARRY_PARENT=")) variables_.push_back(*variable);
  variables_.push_back(parent_.data());
  variables_.push_back(nullptr);
}

}  // namespace quarry
