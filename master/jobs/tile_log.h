#pragma once

#include <cstdio>
#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/protocol/messages.h"

namespace quarry {

/// What each tile touched and cost, one JSON object a line: what the simulator in tests/scalability runs on,
/// and a way to see which part of a picture is dear. Not thread-safe.
class TileLog {
 public:
  /// Errors: the file cannot be written.
  static Result<TileLog> Create(const std::string& path);
  void Frame(const RenderJob& frame_job);
  void Tile(uint32_t frame_number, const TileDone& done, const std::string& worker);

 private:
  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::unique_ptr<std::FILE, Closer> file_;
};

}  // namespace quarry
