// Compiled for plain x86-64, as entry.cpp.
#include "common/api/calls.h"

namespace quarry::api {
namespace {

constexpr unsigned kMostSentence = 1024;
thread_local char sentence[kMostSentence];

}  // namespace

const char* const kRelease = QUARRY_RELEASE;

const char* Sentence() { return sentence; }

void KeepSentence(const char* text) {
  unsigned at = 0;
  for (; text[at] != 0 && at + 1 < kMostSentence; ++at) sentence[at] = text[at];
  // No half letter at the end.
  while (text[at] != 0 && at > 0 && (static_cast<unsigned char>(text[at]) & 0xC0) == 0x80) --at;
  sentence[at] = 0;
}

}  // namespace quarry::api
