#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Saves the importer's state (Importer::Save) in a checkpoint of the sink, if one is due. Requires: called
/// between elements. Errors: the sink's.
template <class Importer>
Status CheckpointIfDue(ModelSink& sink, const Importer& importer) {
  if (!sink.CheckpointDue()) [[likely]]
    return {};
  ByteWriter state;
  importer.Save(state);
  return sink.Checkpoint(state.Take());
}

/// Continues from the last checkpoint of the current file; false if there is none. Errors: Restore()'s; the
/// state is not this importer's.
template <class Importer>
Result<bool> GoOnFromCheckpoint(const ModelSink& sink, const std::string& path, Importer& importer) {
  if (sink.LastCheckpoint().empty()) return false;
  ByteReader state(sink.LastCheckpoint());
  QUARRY_TRY(importer.Restore(state));
  if (!state.done())
    return CannotResume(fmt::format("{}: an earlier run's notes on it cannot be read", path));
  return true;
}

inline void PutText(std::string_view text, ByteWriter& out) {
  out.Put(static_cast<uint32_t>(text.size()));
  out.PutArray(text);
}
inline std::string GetText(ByteReader& in) { return std::string(AsText(in.GetSpan(in.Get<uint32_t>()))); }

}  // namespace quarry
