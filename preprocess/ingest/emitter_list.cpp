#include "preprocess/ingest/emitter_list.h"

#include <algorithm>
#include <cmath>

namespace quarry {

void EmitterList::NoteMaterial(uint32_t number, const Material& material) {
  if (!Shines(material)) return;
  const glm::dvec3 e(EmissionOf(material));
  strengths_[number] = (e.x + e.y + e.z) / 3;
}

void EmitterList::Add(const TriangleRecord& triangle) {
  const auto strength = strengths_.find(triangle.material);
  if (strength == strengths_.end()) return;
  Ranked ranked;
  ranked.emitter.triangle = triangle.id;
  ranked.emitter.part = triangle.part;
  ranked.emitter.material = triangle.material;
  std::ranges::copy(triangle.vertices, ranked.emitter.corners);
  // Shading takes (0, 0) for coordinates that are not finite.
  for (int i = 0; i < 3; ++i)
    if (const glm::vec2& uv = triangle.uvs[i]; std::isfinite(uv.x) && std::isfinite(uv.y))
      ranked.emitter.uvs[i] = uv;
  ranked.power = strength->second * AreaOf(ranked.emitter);
  if (!(ranked.power > 0)) return;
  ranked_.reserve(2 * kMostEmitters);
  ranked_.push_back(ranked);
  if (ranked_.size() == 2 * kMostEmitters) KeepStrongest();
}

void EmitterList::KeepStrongest() {
  if (ranked_.size() <= kMostEmitters) return;
  const auto stronger = [](const Ranked& a, const Ranked& b) {
    return a.power != b.power ? a.power > b.power : a.emitter.triangle < b.emitter.triangle;
  };
  std::ranges::nth_element(ranked_, ranked_.begin() + kMostEmitters, stronger);
  ranked_.resize(kMostEmitters);
}

std::vector<Emitter> EmitterList::Take() {
  KeepStrongest();
  std::vector<Emitter> emitters;
  emitters.reserve(ranked_.size());
  for (const Ranked& ranked : ranked_) emitters.push_back(ranked.emitter);
  std::ranges::sort(emitters, {}, &Emitter::triangle);
  ranked_ = {};
  return emitters;
}

void EmitterList::Save(ByteWriter& out) const {
  out.Put(uint64_t{ranked_.size()});
  out.PutArray(ranked_);
}

void EmitterList::Restore(ByteReader& in) { ranked_ = in.GetArray<Ranked>(in.Get<uint64_t>()); }

}  // namespace quarry
