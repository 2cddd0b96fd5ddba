#pragma once

#include <cstdio>
#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/protocol/messages.h"

namespace quarry {

/// Writes each tile's blocks and cost, one JSON object a line: the input of the simulator in
/// tests/scalability, and a way to find the dear parts of a picture.
/// Units: as the names bear them. Not thread-safe.
class TileLog {
 public:
  /// Errors: the file cannot be written.
  static Result<TileLog> Create(const std::string& path);
  void Frame(uint32_t number, const View& view);
  void Tile(uint32_t frame_number, const TileDone& done, const std::string& worker);

 private:
  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::unique_ptr<std::FILE, Closer> file_;
};

}  // namespace quarry
