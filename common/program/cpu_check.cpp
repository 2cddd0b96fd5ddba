// Compiled for plain x86-64 (see CMakeLists.txt), so that the check runs on processors that cannot run the
// rest.
#include "common/program/cpu_check.h"

#include <unistd.h>

namespace quarry {
namespace {

__attribute__((constructor(101))) void CheckBeforeAnythingElse() {
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2"))
    return;
  static const char kText[] = "quarry: this processor lacks AVX2 and FMA (x86-64-v3), which Quarry needs\n";
  (void)!::write(2, kText, sizeof kText - 1);
  ::_exit(1);
}

}  // namespace

void RequireCpu() {}

}  // namespace quarry
