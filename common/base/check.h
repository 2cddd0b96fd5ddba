#pragma once

#include <cstdio>
#include <cstdlib>

/// Ends the program when one of our own assumptions is broken (never for bad input: that is a Status).
#define QUARRY_CHECK(condition)                                                          \
  do {                                                                                   \
    if (!(condition)) {                                                                  \
      std::fprintf(stderr, "%s:%d: check failed: %s\n", __FILE__, __LINE__, #condition); \
      std::abort();                                                                      \
    }                                                                                    \
  } while (false)

/// As QUARRY_CHECK, in debug builds only; for kernels.
#ifdef NDEBUG
#define QUARRY_DCHECK(condition) \
  do {                           \
  } while (false)
#else
#define QUARRY_DCHECK(condition) QUARRY_CHECK(condition)
#endif
