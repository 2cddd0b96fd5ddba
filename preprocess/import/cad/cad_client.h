#pragma once

#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/import/cad/cad_protocol.h"
#include "preprocess/import/cad/cad_reading.h"
#include "preprocess/import/foreign/helper_process.h"

namespace quarry {

/// The process that reads one STEP or IGES file. Thread safety: none.
class CadClient {
 public:
  explicit CadClient(const CadReading& reading)
      : reading_(reading), helper_(reading.program, reading.memory) {}

  /// Asks for a file. Errors: the process cannot be started.
  Status Ask(CadFormat format, const std::string& path);

  struct Message {
    CadMessage kind{};
    std::span<const std::byte> content;  ///< valid until the next call
  };
  /// Waits for the next message. Errors, each the end of a sentence about the file: the process refuses it,
  /// takes too much memory or time, has crashed, or sends an impossible message. `part`: the part that it
  /// works on, or empty.
  Result<Message> Next(const std::string& part);

  /// The error for a message that no sound process sends.
  static tl::unexpected<Error> Lies();

 private:
  bool Read(std::span<std::byte> out);
  tl::unexpected<Error> Ended(const std::string& part);

  const CadReading& reading_;
  HelperProcess helper_;
  Bytes buffer_, content_;
  size_t at_ = 0;
};

}  // namespace quarry
