#include "preprocess/partition/sample.h"

#include <utility>

namespace quarry {

void TriangleSample::Keep(const TriangleRecord& record) {
  const uint32_t hash = Mix(record.id);
  while (triangles_.size() >= kMost) {
    weight_ *= 2;
    size_t kept = 0;
    for (size_t i = 0; i < triangles_.size(); ++i) {
      if ((hashes_[i] & (weight_ - 1)) != 0) continue;
      triangles_[kept] = triangles_[i];
      looks_[kept] = looks_[i];
      hashes_[kept++] = hashes_[i];
    }
    triangles_.resize(kept);
    hashes_.resize(kept);
    looks_.resize(kept);
    if ((hash & (weight_ - 1)) != 0) return;
  }
  triangles_.push_back({{record.vertices[0], record.vertices[1], record.vertices[2]}});
  hashes_.push_back(hash);
  looks_.push_back({record.colors[0], record.material});
}

void TriangleSample::Save(ByteWriter& out) const {
  out.Put(weight_);
  out.Put(static_cast<uint32_t>(triangles_.size()));
  out.PutArray(hashes_);
  out.PutArray(triangles_);
}

void TriangleSample::Restore(ByteReader& in) {
  weight_ = in.Get<uint32_t>();
  const auto count = in.Get<uint32_t>();
  hashes_ = in.GetArray<uint32_t>(count);
  triangles_ = in.GetArray<KdTriangle>(count);
  looks_.assign(count, {});
}

std::vector<KdTriangle> TriangleSample::TakeTriangles() {
  hashes_ = {};
  looks_ = {};
  return std::exchange(triangles_, {});
}

}  // namespace quarry
