#include "preprocess/ingest/polygon_fan.h"

#include <span>

namespace quarry {

void PolygonFan::Split(std::span<TriangleRecord> fan) {
  positions_.assign({fan[0].vertices[0], fan[0].vertices[1]});
  for (const TriangleRecord& record : fan) positions_.push_back(record.vertices[2]);
  const std::span<const Triangulator::Triangle> triangles = triangulator_.Split(positions_);
  if (triangles.empty()) return;
  const auto corner = [](const TriangleRecord& r, int k) {
    return Corner{r.colors[k], r.normals[k], r.uvs[k]};
  };
  corners_.assign({corner(fan[0], 0), corner(fan[0], 1)});
  for (const TriangleRecord& record : fan) corners_.push_back(corner(record, 2));
  for (size_t i = 0; i < fan.size(); ++i) {
    const uint32_t places[] = {triangles[i].a, triangles[i].b, triangles[i].c};
    for (int k = 0; k < 3; ++k) {
      fan[i].vertices[k] = positions_[places[k]];
      fan[i].colors[k] = corners_[places[k]].color;
      fan[i].normals[k] = corners_[places[k]].normal;
      fan[i].uvs[k] = corners_[places[k]].uv;
    }
  }
}

}  // namespace quarry
