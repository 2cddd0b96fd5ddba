#include "preprocess/import/threemf/shape_reader.h"

#include <fmt/format.h>

#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>

#include "preprocess/import/threemf/attribute_numbers.h"

namespace quarry {
namespace {

/// The mean of three linear colours.
Rgba8 Mean(const Rgba8& a, const Rgba8& b, const Rgba8& c) {
  const auto mean = [](int x, int y, int z) { return static_cast<uint8_t>((x + y + z + 1) / 3); };
  return {mean(a.r, b.r, c.r), mean(a.g, b.g, c.g), mean(a.b, b.b, c.b), mean(a.a, b.a, c.a)};
}

Status Changed() { return Fail("the file changes while it is read"); }

}  // namespace

void ShapeReader::BeginPart(uint32_t part) {
  part_ = part;
  next_object_ = s_.parts[part].first_object;
  depth_ = skipped_ = 0;
  in_object_ = in_mesh_ = shown_ = false;
}

Status ShapeReader::Start(XmlSpace space, std::string_view name, const XmlAttributes& a) {
  ++depth_;
  if (skipped_ != 0) return {};
  if (space != XmlSpace::kCore && space != XmlSpace::kNone) {
    if (space != XmlSpace::kMaterial) skipped_ = depth_;
    return {};
  }
  if (in_mesh_ && name == "vertex") return shown_ ? Vertex(a) : Status{};
  if (in_mesh_ && name == "triangle") return shown_ ? Triangle(a) : Status{};
  if (in_object_ && name == "mesh") in_mesh_ = true;
  if (!in_object_ && name == "object") return BeginObject(a);
  return {};
}

Status ShapeReader::End(XmlSpace, std::string_view name) {
  if (skipped_ == depth_) skipped_ = 0;
  --depth_;
  if (skipped_ != 0) return {};
  if (in_mesh_ && name == "mesh") in_mesh_ = false;
  if (!in_object_ || name != "object") return {};
  in_object_ = false;
  return shown_ ? EndObject() : Status{};
}

Status ShapeReader::BeginObject(const XmlAttributes& a) {
  const ThreeMfStructure::Part& part = s_.parts[part_];
  uint32_t id = 0;
  if (next_object_ >= part.first_object + part.objects || !ReadIndex(a.Find("id"), id)) return Changed();
  object_ = next_object_++;
  if (Object().id != id) return Changed();
  in_object_ = true;
  const double count = s_.graph.count(object_);
  shown_ = count > 0 && Object().triangles > 0;
  if (!shown_) return {};
  vertex_ = 0;
  held_ = (count > 1 || Object().blended != 0) && Object().vertices <= kMostHeldVertices &&
          Object().triangles <= kMostHeldTriangles;
  instances_.clear();
  if (held_) {
    vertices_.reserve(Object().vertices);
    faces_.reserve(Object().triangles);
    return {};
  }
  return s_.graph.ForEach(object_, [this](const glm::dmat4& world, const std::vector<uint32_t>& way) {
    instances_.push_back(ToInstance(world, way));
    return Status{};
  });
}

Status ShapeReader::EndObject() {
  if (vertex_ != Object().vertices) return Changed();
  if (held_)
    QUARRY_TRY(s_.graph.ForEach(object_, [this](const glm::dmat4& world, const std::vector<uint32_t>& way) {
      return GiveHeld(ToInstance(world, way));
    }));
  if (!held_) positions_ += vertex_ * instances_.size();
  vertices_.clear();
  faces_.clear();
  instances_.clear();
  shown_ = false;
  return {};
}

Status ShapeReader::Vertex(const XmlAttributes& a) {
  glm::dvec3 position;
  if (!ReadReal(a.Find("x"), position.x) || !ReadReal(a.Find("y"), position.y) ||
      !ReadReal(a.Find("z"), position.z))
    return Fail("a vertex needs the numbers x, y and z");
  if (++vertex_ > Object().vertices) return Changed();
  if (held_) vertices_.push_back(position);
  for (const Instance& instance : instances_)
    QUARRY_TRY(Sent(sink_.AddPosition(glm::dvec3(instance.world * glm::dvec4(position, 1)), {})));
  return {};
}

Status ShapeReader::Triangle(const XmlAttributes& a) {
  constexpr const char* kNames[] = {"v1", "v2", "v3"};
  Face face;
  for (int corner = 0; corner < 3; ++corner) {
    if (!ReadIndex(a.Find(kNames[corner]), face.vertex[corner]))
      return Fail("a triangle needs v1, v2 and v3, numbers of vertices");
    if (face.vertex[corner] >= Object().vertices)
      return Fail(fmt::format("the triangle refers to vertex {}, but object {} has only {}, from 0",
                              face.vertex[corner], Object().id, Object().vertices));
  }
  QUARRY_ASSIGN(const TriangleLook stated, TriangleLook::Read(a));
  looks_missing_ = false;
  const uint32_t group = stated.stated && stated.group != 0 ? stated.group : Object().group;
  for (int corner = 0; corner < 3; ++corner)
    face.look[corner] = corner > 0 && !stated.differs()
                            ? face.look[0]
                            : LookOf(group, stated.stated ? stated.index[corner] : Object().index);
  if (looks_missing_) ++plain_;
  if (!held_ && IsBlended(face)) ++averaged_;
  if (held_) {
    if (faces_.size() >= Object().triangles) return Changed();
    faces_.push_back(face);
  }
  for (size_t i = 0; i < instances_.size(); ++i) {
    uint32_t corners[3];
    for (int corner = 0; corner < 3; ++corner)
      corners[corner] =
          static_cast<uint32_t>(positions_ + uint64_t{face.vertex[corner]} * instances_.size() + i);
    QUARRY_TRY(GiveFace(face, corners, instances_[i]));
  }
  return {};
}

ThreeMfProperties::Look ShapeReader::LookOf(uint32_t group, uint32_t index) {
  ThreeMfProperties::Look look;
  if (group != 0 && !s_.properties.Find(part_, group, index, look)) looks_missing_ = true;
  return look;
}

ShapeReader::Instance ShapeReader::ToInstance(const glm::dmat4& world, const std::vector<uint32_t>& way) {
  uint32_t part = kNoIndex;
  for (size_t i = way.size(); i-- > 0;)
    if (const std::string& name = s_.objects[way[i]].name; !name.empty()) part = sink_.AddPart(name, part);
  return {world, part, glm::determinant(glm::dmat3(world)) < 0};
}

Status ShapeReader::GiveHeld(const Instance& instance) {
  const auto place = [&](const glm::dvec3& p) { return glm::dvec3(instance.world * glm::dvec4(p, 1)); };
  for (const glm::dvec3& p : vertices_) QUARRY_TRY(Sent(sink_.AddPosition(place(p), {})));
  const uint64_t first = positions_;
  positions_ += vertices_.size();
  for (const Face& face : faces_) {
    uint32_t corners[3];
    const bool blended = IsBlended(face);
    for (int corner = 0; corner < 3; ++corner) {
      corners[corner] = static_cast<uint32_t>(blended ? positions_++ : first + face.vertex[corner]);
      if (blended)
        QUARRY_TRY(Sent(sink_.AddPosition(place(vertices_[face.vertex[corner]]), face.look[corner].color)));
    }
    QUARRY_TRY(GiveFace(face, corners, instance));
  }
  return {};
}

/// Gives a triangle whose corners have those numbers in the sink; the first corner's material counts.
Status ShapeReader::GiveFace(const Face& face, const uint32_t (&corners)[3], const Instance& instance) {
  const auto& look = face.look;
  if (IsBlended(face))
    QUARRY_TRY(SetColor(held_ ? Rgba8() : Mean(look[0].color, look[1].color, look[2].color)));
  else
    QUARRY_TRY(SetColor(look[0].colored ? look[0].color : Rgba8()));
  const bool turn = instance.mirrored;
  const Corner polygon[3] = {{corners[0]}, {corners[turn ? 2 : 1]}, {corners[turn ? 1 : 2]}};
  ++triangles_;
  return Sent(sink_.AddPolygon(polygon, look[0].material, instance.part));
}

Status ShapeReader::SetColor(const Rgba8& color) {
  if (Packed(color) == face_color_) return {};
  face_color_ = Packed(color);
  return Sent(sink_.SetFaceColor(color));
}

void ShapeReader::Finish() {
  if (plain_ != 0)
    sink_.Warn(
        fmt::format("{}: {} triangles have a material or colour that is not there or not read; they get "
                    "the default",
                    path_, plain_));
  if (averaged_ != 0)
    sink_.Warn(
        fmt::format("{}: {} triangles of large objects have a colour for each corner; they get the mean",
                    path_, averaged_));
}

}  // namespace quarry
