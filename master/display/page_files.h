#pragma once

#include <string_view>

namespace quarry {

/// A file of the page, built into the program.
struct PageFile {
  std::string_view name, content_type, content;
};

/// The file of that name, or null. Thread-safe.
const PageFile* FindPageFile(std::string_view name);

}  // namespace quarry
