#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"

namespace quarry {

/// How formats are read that Quarry has no reader for.
struct ForeignFormats {
  std::string program;  ///< quarry-import-assimp; empty: they are refused
  std::string prefix;   ///< of the files that it writes: PREFIX.ply and PREFIX.materials.json
  uint64_t memory = 0;  ///< bytes that it may take
};

/// Memory that Assimp takes, over a file's bytes: the most of COLLADA, X, PLY and OBJ as measured
/// (preprocess/README.md). What is packed within itself may take more.
inline constexpr uint64_t kForeignBytesPerByte = 50;

/// A model as PLY with its materials beside it, in files that go with the object.
class ForeignModel {
 public:
  /// Starts the program on `model`. Errors: its sentence, or that it crashed.
  static Result<ForeignModel> Convert(const std::string& model, const ForeignFormats& formats);
  ForeignModel(ForeignModel&& other) noexcept;
  ForeignModel& operator=(ForeignModel&&) = delete;
  ~ForeignModel();

  std::string ply() const { return prefix_ + ".ply"; }

 private:
  explicit ForeignModel(std::string prefix);
  std::string library() const { return prefix_ + ".materials.json"; }
  std::string prefix_;
  int cleanups_[2];  ///< see RemoveOnSignal
};

}  // namespace quarry
