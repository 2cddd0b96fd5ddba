#pragma once

#include <string>

namespace quarry::test {

/// Prints the reason why the present test, or a part of it, is skipped. A test program with skips and without
/// failures ends with status 77, which ctest reports as skipped.
void Skip(const std::string& reason);

}  // namespace quarry::test
