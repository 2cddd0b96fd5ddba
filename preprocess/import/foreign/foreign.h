#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"

namespace quarry {

/// How to read formats for which Quarry has no reader.
struct ForeignFormats {
  std::string program;  ///< quarry-import-assimp; empty: such formats are refused
  std::string prefix;   ///< of the files written: PREFIX.ply, PREFIX.materials.json, PREFIX.image-...
  uint64_t memory = 0;  ///< bytes that the program may take
};

/// Memory that Assimp takes, over a file's bytes: the maximum of COLLADA, X, PLY and OBJ as measured
/// (tests/bench/history/preprocess.md). A format that is packed within itself may take more.
inline constexpr uint64_t kForeignBytesPerByte = 50;

/// Removes the files PREFIX.image-..., the images that were inside of models.
void RemoveForeignImages(const std::string& prefix);

/// A model converted to PLY, with its materials beside it, in files that are deleted with the object. Images
/// that were inside of the model lie in files PREFIX.image-HASH, which stay: the import names them.
class ForeignModel {
 public:
  /// Runs the program on `model`. Errors: its own sentence; it crashed.
  static Result<ForeignModel> Convert(const std::string& model, const ForeignFormats& formats);
  ForeignModel(ForeignModel&& other) noexcept;
  ForeignModel& operator=(ForeignModel&&) = delete;
  ~ForeignModel();

  std::string ply() const { return prefix_ + ".ply"; }

 private:
  explicit ForeignModel(std::string prefix);
  std::string library() const { return prefix_ + ".materials.json"; }
  std::string prefix_;
  int cleanups_[2];  ///< of the two files, see RemoveOnSignal()
};

}  // namespace quarry
