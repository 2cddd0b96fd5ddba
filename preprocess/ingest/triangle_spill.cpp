#include "preprocess/ingest/triangle_spill.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "preprocess/import/model_sink.h"
#include "preprocess/ingest/up_evidence.h"
#include "preprocess/partition/regions.h"

namespace quarry {

std::string TriangleSpill::Path() const {
  return fmt::format("{}/triangles-{}", folder_, static_cast<int>(out_.attributes));
}

Result<SpillFile> TriangleSpill::OpenFile(uint64_t count) {
  SpillFile::Options options;
  options.writer = &writer_;
  return SpillFile::Open(Path(), RecordBytes(out_.attributes), count, options);
}

Status TriangleSpill::Open() {
  if (out_.triangles) return {};
  QUARRY_ASSIGN(out_.triangles, OpenFile(0));
  return {};
}

Result<uint32_t> TriangleSpill::NewIds(uint64_t count, const std::string& file_name) {
  constexpr uint64_t kMaxTriangles = 0xFFFFFFFFull;  // the last id is kNoIndex
  if (out_.input_triangles + count >= kMaxTriangles)
    return Fail(fmt::format("{}: more than {} triangles in all: ids are 32 bits; split the model", file_name,
                            kMaxTriangles - 1));
  const auto first = static_cast<uint32_t>(out_.input_triangles);
  out_.input_triangles += count;
  return first;
}

Status TriangleSpill::WidenNow(Attributes attributes) {
  out_.attributes = attributes;
  SpillFile before = std::move(*out_.triangles);
  QUARRY_TRY(before.FinishWriting());
  QUARRY_ASSIGN(out_.triangles, OpenFile(0));
  SpillReader records(before);
  while (const std::byte* kept = records.Next()) {
    TriangleRecord record;
    std::memcpy(&record, kept, before.element_bytes());
    QUARRY_TRY(out_.triangles->Append(&record));
  }
  QUARRY_TRY(records.status());
  before.Remove();
  return {};
}

void TriangleSpill::Check(std::span<TriangleRecord> fan, TriangleBatch& batch) const {
  if (fan.size() > 1) batch.polygon.Split(fan);
  for (TriangleRecord& record : fan) {
    if (!alpha_levels_.empty()) TakeAlpha(record);
    CheckTriangle(record, batch);
  }
}

Status TriangleSpill::AddPolygon(std::span<TriangleRecord> fan) {
  one_.Clear();
  Check(fan, one_);
  return Take(one_);
}

/// Turns the alpha of the corners into the material of its level. Stores hold opaque colours.
void TriangleSpill::TakeAlpha(TriangleRecord& record) const {
  constexpr uint32_t kOpaque = 0xFF000000;
  uint32_t sum = 0;
  for (uint32_t& color : record.colors) {
    sum += color >> 24;
    color |= kOpaque;
  }
  const auto levels = alpha_levels_.find(record.material);
  const uint32_t level = (sum * kAlphaLevels + 3 * 255 / 2) / (3 * 255);
  if (levels == alpha_levels_.end() || level >= kAlphaLevels) return;
  record.material = static_cast<uint16_t>(std::min<uint32_t>(levels->second + level, 65535));
}

void TriangleSpill::CheckTriangle(TriangleRecord& record, TriangleBatch& batch) const {
  const TriangleFault fault = FaultOf(record);
  batch.dropped_not_finite += fault == TriangleFault::kNotFinite;
  batch.dropped_degenerate += fault == TriangleFault::kDegenerate;
  AddToRuns(record, fault, batch.parts);
  if (fault != TriangleFault::kNone) return;
  batch.bounds.IncludeBox(record.PaddedBox(0));
  const auto index = static_cast<uint32_t>(batch.kept.size());
  if (out_.sample.Takes(record.id)) batch.sampled.push_back(index);
  if (!emitters_.empty() && emitters_.Wants(record.material)) batch.shining.push_back(index);
  if (out_.attributes >= Attributes::kNormals) MarkOwnNormals(record);
  batch.kept.push_back(record);
}

Status TriangleSpill::Take(const TriangleBatch& batch) {
  out_.dropped_not_finite += batch.dropped_not_finite;
  out_.dropped_degenerate += batch.dropped_degenerate;
  out_.bounds.IncludeBox(batch.bounds);
  for (const PartRun& run : batch.parts) parts_.Add(run);
  for (const uint32_t i : batch.sampled) out_.sample.Add(batch.kept[i]);
  for (const uint32_t i : batch.shining) emitters_.Add(batch.kept[i]);
  for (const TriangleRecord& record : batch.kept) QUARRY_TRY(out_.triangles->Append(&record));
  return {};
}

void TriangleSpill::WeighUp() {
  const std::vector<KdTriangle>& sample = out_.sample.triangles();
  if (!sample.empty()) out_.up_evidence = UpEvidence(sample);
}

bool TriangleSpill::spills() const { return out_.triangles && out_.triangles->count() > kMostInMemory; }

Status TriangleSpill::Save(ByteWriter& out) {
  QUARRY_TRY(out_.triangles->WriteOut());
  out.Put(static_cast<uint8_t>(out_.attributes));
  out.PutVec3(out_.bounds.lower);
  out.PutVec3(out_.bounds.upper);
  for (const uint64_t n :
       {out_.triangles->count(), out_.input_triangles, out_.dropped_degenerate, out_.dropped_not_finite})
    out.Put(n);
  out_.sample.Save(out);
  parts_.Save(out);
  emitters_.Save(out);
  return {};
}

Status TriangleSpill::Restore(ByteReader& in, bool routed) {
  out_.attributes = static_cast<Attributes>(std::min<uint8_t>(in.Get<uint8_t>(), 3));
  out_.bounds.lower = in.GetVec3<glm::vec3>();
  out_.bounds.upper = in.GetVec3<glm::vec3>();
  const auto count = in.Get<uint64_t>();
  out_.input_triangles = in.Get<uint64_t>();
  out_.dropped_degenerate = in.Get<uint64_t>();
  out_.dropped_not_finite = in.Get<uint64_t>();
  out_.sample.Restore(in);
  parts_.Restore(in);
  emitters_.Restore(in);
  if (routed) {
    out_.triangles = SpillFile::Left(Path(), RecordBytes(out_.attributes), count);
    WeighUp();
    out_.sample = {};
    return {};
  }
  QUARRY_ASSIGN(out_.triangles, OpenFile(count));
  return {};
}

}  // namespace quarry
