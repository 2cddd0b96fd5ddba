#pragma once

#include <string>

namespace quarry::test {

/// Says why the present test, or a part of it, is skipped. A program that has skipped something and failed
/// nothing ends with status 77, which ctest reports as skipped.
void Skip(const std::string& reason);

}  // namespace quarry::test
