#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/protocol/messages.h"
#include "common/voxel/store_reader.h"

/// Shared by the programs that fuzz sessions: bytes read as a script, and parts of messages made from them.
namespace quarry::fuzz {

/// The fuzz program's bytes, from the first to the last; zeroes after them.
class Script {
 public:
  Script(const uint8_t* data, size_t size) : at_(data), end_(data + size) {}
  bool over() const { return at_ == end_; }
  uint8_t Byte() { return over() ? 0 : *at_++; }
  uint32_t Below(uint32_t n) { return Byte() % n; }
  /// Mostly small; now and then any.
  uint32_t Number();
  std::string Text();
  Bytes Some();

 private:
  const uint8_t *at_, *end_;
};

/// The store that QUARRY_FUZZ_STORE names; without one the program ends. Opened once.
const std::string& StorePath();
StoreReader& Store();

/// A picture of a few tiles.
RenderJob AnyJob(Script& script);
/// A message of any type: its table one that fits, one of another type, or no table at all. None of them asks
/// for a picture that would take all memory or a day, which is no finding here.
Message AnyMessage(Script& script);

/// Prints the name of a program under test that does not end although the other sides behave, and aborts.
[[noreturn]] void NeverEnds(const char* what);

/// Each program's own plays to begin with. With QUARRY_WRITE_SEEDS=FOLDER it writes them there and ends.
std::vector<std::vector<uint8_t>> Seeds();

}  // namespace quarry::fuzz
