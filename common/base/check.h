#pragma once

#include <cstdio>
#include <cstdlib>

namespace quarry {

[[noreturn, gnu::cold, gnu::noinline]] inline void CheckFailed(const char* file, int line,
                                                               const char* condition, long long a,
                                                               long long b) {
  std::fprintf(stderr, "%s:%d: check failed: %s (%lld and %lld)\n", file, line, condition, a, b);
  std::abort();
}

}  // namespace quarry

/// Aborts the program when an assumption of Quarry's own code is broken. Bad input is a Status, never a
/// check.
#define QUARRY_CHECK(condition)                                                          \
  do {                                                                                   \
    if (!(condition)) {                                                                  \
      std::fprintf(stderr, "%s:%d: check failed: %s\n", __FILE__, __LINE__, #condition); \
      std::abort();                                                                      \
    }                                                                                    \
  } while (false)

/// Compares two integers as QUARRY_CHECK does, and prints both values on failure.
#define QUARRY_CHECK_OP(a, op, b)                                                                    \
  do {                                                                                               \
    const auto quarry_a = (a);                                                                       \
    const auto quarry_b = (b);                                                                       \
    if (!(quarry_a op quarry_b))                                                                     \
      ::quarry::CheckFailed(__FILE__, __LINE__, #a " " #op " " #b, static_cast<long long>(quarry_a), \
                            static_cast<long long>(quarry_b));                                       \
  } while (false)
#define QUARRY_CHECK_EQ(a, b) QUARRY_CHECK_OP(a, ==, b)
#define QUARRY_CHECK_LE(a, b) QUARRY_CHECK_OP(a, <=, b)
#define QUARRY_CHECK_LT(a, b) QUARRY_CHECK_OP(a, <, b)

/// QUARRY_CHECK in debug builds, nothing in release builds; for kernels.
#ifdef NDEBUG
#define QUARRY_DCHECK(condition) \
  do {                           \
  } while (false)
#else
#define QUARRY_DCHECK(condition) QUARRY_CHECK(condition)
#endif
