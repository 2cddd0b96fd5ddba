#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "common/base/bytes.h"
#include "preprocess/import/cad/cad_protocol.h"

namespace quarry {

/// The helper's side of the pipe. Messages are gathered and sent in pieces. Ends the process when the reader
/// is gone. Thread safety: none.
class CadOutput {
 public:
  explicit CadOutput(int fd) : fd_(fd) {}
  CadOutput(const CadOutput&) = delete;

  /// Requires: at most kMostCadMessage bytes.
  void Put(CadMessage kind, std::span<const std::byte> content);
  /// Text beyond kMostCadText bytes is cut.
  void Put(CadMessage kind, std::string_view text);
  void Progress(double share);
  void Flush();

 private:
  int fd_;
  Bytes gathered_;
  double reported_ = -1;
};

/// Whether this process has come near the limit of its address space. Open CASCADE hides an allocation that
/// failed: it leaves out the shape or the face. A model is refused then, so that its triangles never depend
/// on memory. `losses`: something was left out, so within a quarter of the limit is near. The failure of a
/// larger allocation is not seen.
bool MemoryIsShort(bool losses = false);

}  // namespace quarry
