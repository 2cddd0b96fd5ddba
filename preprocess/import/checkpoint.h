#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// How importers leave off and go on: by what `Save` puts, and `Restore` takes back. To be called between
/// elements. Errors: the sink's.
template <class Importer>
Status CheckpointIfDue(ModelSink& sink, const Importer& importer) {
  if (!sink.CheckpointDue()) [[likely]]
    return {};
  ByteWriter state;
  importer.Save(state);
  return sink.Checkpoint(state.Take());
}

/// Goes on from the last checkpoint, if there is one, and says whether. Errors: Restore's; the state is none
/// of this importer's.
template <class Importer>
Result<bool> GoOnFromCheckpoint(const ModelSink& sink, const std::string& path, Importer& importer) {
  if (sink.LastCheckpoint().empty()) return false;
  ByteReader state(sink.LastCheckpoint());
  QUARRY_TRY(importer.Restore(state));
  if (!state.done())
    return Fail(
        fmt::format("{}: what an earlier run noted of it cannot be read; begin anew without --resume", path));
  return true;
}

inline void PutText(std::string_view text, ByteWriter& out) {
  out.Put(static_cast<uint32_t>(text.size()));
  out.PutArray(text);
}
inline std::string GetText(ByteReader& in) { return std::string(AsText(in.GetSpan(in.Get<uint32_t>()))); }

}  // namespace quarry
