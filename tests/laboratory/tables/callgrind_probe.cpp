#include <cstdint>
#include <cstdio>
#include <cstdlib>

// A program whose functions are called as often as its argument says: callgrind_test.cpp counts them.
// Usage: quarry-laboratory-probe CALLS [STATUS]

namespace quarry::laboratory::probe {

/// Work that no compiler shortens: each step needs the last.
[[gnu::noinline]] uint64_t Inner(uint64_t x) {
  for (int i = 0; i < 100; ++i) {
    x ^= x << 13;
    x ^= x >> 7;
    x ^= x << 17;
    asm volatile("" : "+r"(x));
  }
  return x;
}

/// Calls Inner three times.
[[gnu::noinline]] uint64_t Outer(uint64_t x) {
  for (int i = 0; i < 3; ++i) x += Inner(x + 1);
  return x;
}

[[gnu::noinline]] uint64_t Never(uint64_t x) {
  asm volatile("" : "+r"(x));
  return x + 1;
}

}  // namespace quarry::laboratory::probe

int main(int argc, char** argv) {
  namespace probe = quarry::laboratory::probe;
  const int calls = argc > 1 ? std::atoi(argv[1]) : 0;
  uint64_t x = 88172645463325252ull;
  for (int i = 0; i < calls; ++i) x = probe::Outer(x);
  if (calls < 0) x = probe::Never(x);
  std::printf("%llu\n", static_cast<unsigned long long>(x));
  const int status = argc > 2 ? std::atoi(argv[2]) : 0;
  if (status == -1) std::abort();
  if (status) std::fprintf(stderr, "the probe fails as asked\n");
  return status;
}
