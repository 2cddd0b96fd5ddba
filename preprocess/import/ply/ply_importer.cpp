// PLY after its header: elements in file order, each row read by a plan that is made once per element.
// Source: Turk, "The PLY Polygon File Format", 1994.

#include <fmt/format.h>

#include <algorithm>
#include <tuple>
#include <utility>

#include "preprocess/import/carried_fields.h"
#include "preprocess/import/file_color.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/ply/ply_row_reader.h"
#include "preprocess/import/ply/ply_tables.h"
#include "preprocess/import/row_chunk.h"

namespace quarry {
namespace {

bool HasNoFaces(const PlyHeader& header) {
  const auto has = [&](const char* name) {
    const PlyElement* element = header.Find(name);
    return element != nullptr && element->count != 0;
  };
  return !has("face") && !has("tristrips");
}

template <typename Source>
class PlyBody {
 public:
  PlyBody(const PlyHeader& header, Source source, const std::string& model, ModelSink& sink)
      : header_(header),
        rows_(source),
        sink_(sink),
        path_(rows_.source.bytes().path()),
        tables_(rows_.source.bytes(), model, sink) {}

  Result<uint64_t> Import() {
    const PlyElement* vertex = header_.Find("vertex");
    if (vertex == nullptr) return rows_.source.FailHere("the PLY header has no element \"vertex\"");
    vertex_count_ = vertex->count;
    const PlyPlan plan = PlanVertex(*vertex);
    if (!plan.Has(kX, kZ)) return rows_.source.FailHere("the element \"vertex\" lacks x, y or z");
    if (HasNoFaces(header_) &&
        std::ranges::find(vertex->properties, "f_dc_0", &PlyProperty::name) != vertex->properties.end())
      return Fail(fmt::format(
          "{}: holds {} Gaussian splats and no faces: there is no surface to trace; make a mesh of "
          "them first",
          path_, vertex_count_));
    if (HasNoFaces(header_) && vertex_count_ != 0) return NoFaces(path_, vertex_count_);
    has_normals_ = plan.Has(kNx, kNz);
    const PlyElement* const face = header_.Find("face");
    has_uv_lists_ =
        face != nullptr && PlanFace(*face).has_uv_list;  // uvs of corners are finer than uvs of vertices
    has_uvs_ = plan.Has(kU, kV) && !has_uv_lists_;
    has_colors_ = plan.Has(kRed, kBlue);
    CompareFields();
    if (face) QUARRY_TRY(tables_.LoadLibrary(PlanFace(*face)));
    QUARRY_TRY(tables_.LoadTextures(header_, has_uvs_ || has_uv_lists_));
    uint64_t rows = 0;
    for (const PlyElement& element : header_.elements) rows += element.properties.empty() ? 0 : element.count;
    rows_.source.LookForRows(rows);
    for (const PlyElement& element : header_.elements) {
      QUARRY_TRY(Element(element));
      rows_.row_number = 0;
    }
    if (rows_.long_rows != 0)
      sink_.Warn(fmt::format("{}: {} lines hold more values than the header names; the rest is left out",
                             path_, rows_.long_rows));
    if (short_faces_ != 0)
      sink_.Warn(fmt::format("{}: {} faces of fewer than 3 corners left out", path_, short_faces_));
    return triangles_;
  }

 private:
  void CompareFields() {
    CarriedFields fields;
    for (const PlyElement& element : header_.elements) {
      if (element.count == 0) continue;
      fields.Names(FieldKind::kPlyElement, element.name);
      for (const PlyProperty& property : element.properties) {
        if (element.name == "vertex") fields.Names(FieldKind::kPlyVertex, property.name);
        if (element.name == "face") fields.Names(FieldKind::kPlyFace, property.name);
      }
    }
    fields.Warn(path_, sink_);
  }

  bool HasCornerUvs() const { return has_uv_lists_ && rows_.row.uvs.size() == 2 * corners_.size(); }

  /// The material of a face's image: the only image, or that of the row's number; kNoIndex: it has none.
  uint32_t TextureMaterial(const PlyPlan& plan, const double* values) const {
    if (!tables_.textures.wanted) return kNoIndex;
    const std::vector<uint32_t>& listed = tables_.textures.scene_index;
    const double number = plan.Has(kTextureNumber, kTextureNumber) ? values[kTextureNumber] : 0;
    const bool is_listed = number >= 0 && number < static_cast<double>(listed.size());
    return is_listed ? listed[static_cast<size_t>(number)] : kNoIndex;
  }

  /// Gives the corners their own texture coordinates, if the row has as many.
  Status AddCornerUvs() {
    if (!HasCornerUvs()) return {};
    const std::vector<float>& uvs = rows_.row.uvs;
    if (uv_count_ >= kNoIndex - corners_.size())
      return rows_.source.FailHere("there are more texture coordinates than 4,294,967,294");
    for (size_t i = 0; i < corners_.size(); ++i) {
      QUARRY_TRY(sink_.AddUv({uvs[2 * i], uvs[2 * i + 1]}));
      corners_[i].uv = uv_count_++;
    }
    return {};
  }

  Status Element(const PlyElement& element) {
    if (element.properties.empty()) return {};  // rows without values, whatever the count
    if (element.name == "vertex") {
      const PlyPlan plan = PlanVertex(element);
      if constexpr (Source::kBinary)
        if (!plan.has_lists && !HasRealColors(plan)) return Vertices(element, plan);
      return rows_.Read(element, plan, [&] { return Vertex(plan); });
    }
    if (element.name == "face") {
      const PlyPlan plan = PlanFace(element);
      if (!plan.has_index_list)
        return rows_.source.FailHere("the element \"face\" has no list vertex_indices of an integer type");
      if constexpr (Source::kBinary)
        if (plan.triangle_bytes != 0 && !HasRealColors(plan)) return Faces(element, plan);
      return rows_.Read(element, plan, [&] { return Face(plan); });
    }
    if (element.name == "tristrips") return Strips(element);
    return rows_.Read(element, PlanToSkip(element), [] { return Status(); });
  }

  /// Whether colours are real numbers. Their channels run to 1. A channel above kMostOfOne shows that the
  /// file's channels run to 255, in that row and the later ones.
  static bool HasRealColors(const PlyPlan& plan) {
    return plan.Has(kRed, kBlue) && plan.color_scale[0] == kScaleOfReal;
  }

  Rgba8 RowColor(const PlyPlan& plan) {
    const double* values = rows_.row.values;
    const bool real = HasRealColors(plan);
    if (real && std::max({values[kRed], values[kGreen], values[kBlue]}) > kMostOfOne) real_to_255_ = true;
    return ColorOf(plan, values, real_to_255_ && real);
  }

  static Rgba8 ColorOf(const PlyPlan& plan, const double* values, bool is_of_255) {
    const auto channel = [&](int i) { return values[kRed + i] * (is_of_255 ? 1 : plan.color_scale[i]); };
    return FileColor(channel(0), channel(1), channel(2), plan.Has(kAlpha, kAlpha) ? channel(3) : 255);
  }

  /// Vertices whose rows have one size, many at once.
  Status Vertices(const PlyElement& element, const PlyPlan& plan) {
    const PlyValues<Source> values(plan, 0, 0);
    QUARRY_TRY(rows_.ExpectRows(element, values.end()));
    const bool has_colors = plan.Has(kRed, kBlue);
    struct Vertex {
      glm::dvec3 position;
      Rgba8 color;
    };
    std::vector<Vertex> vertices;
    std::vector<glm::vec3> normals;
    std::vector<glm::vec2> uvs;
    while (rows_.row_number < element.count) {
      RowChunk chunk(rows_.source.bytes(), values.end(), element.count - rows_.row_number, sink_.team());
      if (chunk.rows() == 0) return rows_.RowFailure(element);
      vertices.resize(chunk.rows());
      normals.resize(has_normals_ ? chunk.rows() : 0);
      uvs.resize(has_uvs_ ? chunk.rows() : 0);
      chunk.Decode([&](const char* row, size_t i) {
        double value[PlyRow::kMaxValues] = {};
        values.Load(row, value);
        vertices[i].position = {value[kX], value[kY], value[kZ]};
        vertices[i].color = has_colors ? ColorOf(plan, value, false) : Rgba8{};
        if (has_normals_) normals[i] = glm::vec3(value[kNx], value[kNy], value[kNz]);
        if (has_uvs_) uvs[i] = glm::vec2(value[kU], value[kV]);
        return true;
      });
      for (const auto& [position, color] : vertices) QUARRY_TRY(sink_.AddPosition(position, color));
      for (const glm::vec3& normal : normals) QUARRY_TRY(sink_.AddNormal(normal));
      for (const glm::vec2& uv : uvs) QUARRY_TRY(sink_.AddUv(uv));
      chunk.Consume(chunk.rows());
      rows_.row_number += chunk.rows();
    }
    return {};
  }

  struct Triangle {
    Corner corners[3];
    uint32_t material = kNoIndex, part = kNoIndex;
    Rgba8 color;
  };

  /// Faces, of which triangles of the usual form are read many at once, and others one by one.
  Status Faces(const PlyElement& element, const PlyPlan& plan) {
    const PlyValues<Source> values(plan, 1, kTriangleBytes);
    const bool has_color = !has_colors_ && plan.Has(kRed, kBlue);
    std::vector<Triangle> triangles;
    while (rows_.row_number < element.count) {
      RowChunk chunk(rows_.source.bytes(), plan.triangle_bytes, element.count - rows_.row_number,
                     sink_.team());
      chunk.CutBefore([](const char* row) { return *row == 3; });
      triangles.resize(chunk.rows());
      const size_t good = chunk.Decode(
          [&](const char* row, size_t i) { return PlainTriangle(plan, values, row, triangles[i]); });
      for (const Triangle& triangle : std::span(triangles).first(good)) {
        if (has_color) QUARRY_TRY(sink_.SetFaceColor(triangle.color));
        QUARRY_TRY(sink_.AddPolygon(triangle.corners, triangle.material, triangle.part));
      }
      triangles_ += good;
      chunk.Consume(good);
      rows_.row_number += good;
      // The row that follows is of another form, has a fault, or is not all in the buffer.
      if (rows_.row_number < element.count)
        QUARRY_TRY(rows_.ReadNext(element, plan, [&] { return Face(plan); }));
    }
    return {};
  }

  /// False: the row has a fault.
  bool PlainTriangle(const PlyPlan& plan, const PlyValues<Source>& values, const char* row,
                     Triangle& triangle) const {
    double value[PlyRow::kMaxValues] = {};
    values.Load(row, value);
    const bool is_signed = plan.steps[0].type == PlyType::kInt32;
    for (int k = 0; k < 3; ++k) {
      const uint32_t word = Source::Word(row + 1 + 4 * k);
      if (!IsVertex(is_signed ? int64_t{static_cast<int32_t>(word)} : int64_t{word})) return false;
      triangle.corners[k] = MakeCorner(word);
    }
    if (!tables_.materials.Look(value[kMaterial], triangle.material)) return false;
    if (!tables_.parts.Look(value[kPart], triangle.part)) return false;
    if (!tables_.materials.wanted) triangle.material = TextureMaterial(plan, value);
    if (!has_colors_ && plan.Has(kRed, kBlue)) triangle.color = ColorOf(plan, value, false);
    return true;
  }

  Status Vertex(const PlyPlan& plan) {
    const double* value = rows_.row.values;
    const Rgba8 color = plan.Has(kRed, kBlue) ? RowColor(plan) : Rgba8{};
    QUARRY_TRY(sink_.AddPosition({value[kX], value[kY], value[kZ]}, color));
    if (has_normals_) QUARRY_TRY(sink_.AddNormal(glm::vec3(value[kNx], value[kNy], value[kNz])));
    if (has_uvs_) QUARRY_TRY(sink_.AddUv(glm::vec2(value[kU], value[kV])));
    return {};
  }

  Status Face(const PlyPlan& plan) {
    if (rows_.row.indices.size() < 3) {
      ++short_faces_;
      return {};
    }
    corners_.resize(rows_.row.indices.size());
    for (size_t i = 0; i < corners_.size(); ++i) {
      const int64_t index = rows_.row.indices[i];
      if (!IsVertex(index)) return NoVertex(index);
      corners_[i] = MakeCorner(index);
    }
    uint32_t material, part;
    const double* values = rows_.row.values;
    if (!tables_.materials.Look(values[kMaterial], material))
      return NotListed(tables_.materials, kMaterial, "material_index");
    if (!tables_.parts.Look(values[kPart], part)) return NotListed(tables_.parts, kPart, "part_index");
    if (!tables_.materials.wanted && (!has_uv_lists_ || HasCornerUvs()))
      material = TextureMaterial(plan, values);
    QUARRY_TRY(AddCornerUvs());
    triangles_ += corners_.size() - 2;
    // Vertices' colours take precedence: they are finer.
    if (!has_colors_ && plan.Has(kRed, kBlue)) QUARRY_TRY(sink_.SetFaceColor(RowColor(plan)));
    return sink_.AddPolygon(corners_, material, part);
  }

  bool IsVertex(int64_t index) const {
    return index >= 0 && static_cast<uint64_t>(index) < vertex_count_ && index < int64_t{kNoIndex};
  }
  tl::unexpected<Error> NoVertex(int64_t index) const {
    return rows_.source.FailHere(
        fmt::format("face {} (counted from 0) refers to vertex {}, but there are {} vertices",
                    rows_.row_number, index, vertex_count_));
  }

  Corner MakeCorner(int64_t index) const {
    const auto i = static_cast<uint32_t>(index);
    return Corner{i, has_normals_ ? i : kNoIndex, has_uvs_ ? i : kNoIndex};
  }

  tl::unexpected<Error> NotListed(const IndexTable& table, FaceSlot slot, const char* name) {
    return rows_.source.FailHere(fmt::format("face {} (counted from 0) has {} {}, but {} lists {}",
                                             rows_.row_number, name, rows_.row.values[slot],
                                             tables_.LibraryPath(), table.scene_index.size()));
  }

  /// A strip may be the whole model in one list, so it is read in pieces.
  Status Strips(const PlyElement& element) {
    const PlyPlan plan = PlanFace(element);
    for (; rows_.row_number < element.count; ++rows_.row_number) {
      strip_length_ = 0;
      for (const PlyStep& step : plan.steps) {
        if (step.target == PlyStep::kIndexList)
          QUARRY_TRY(StripList(element, step));
        else if (!rows_.ReadStep(step))
          return rows_.RowFailure(element);
      }
    }
    return {};
  }

  Status StripList(const PlyElement& element, const PlyStep& step) {
    int64_t left;
    if (!rows_.source.Integer(*step.count_type, left)) return rows_.RowFailure(element);
    while (left > 0) {
      const int64_t piece = std::min<int64_t>(left, 4096);
      rows_.row.indices.clear();
      if (!rows_.source.Integers(step.type, static_cast<uint64_t>(piece), rows_.row.indices))
        return rows_.RowFailure(element);
      for (const int64_t index : rows_.row.indices) QUARRY_TRY(StripIndex(index));
      left -= piece;
    }
    return {};
  }

  /// -1 starts a new strip. Every second triangle is turned back; triangles with a repeated corner, which
  /// only join strips, are dropped.
  Status StripIndex(int64_t index) {
    if (index == -1) {
      strip_length_ = 0;
      return {};
    }
    if (!IsVertex(index)) return NoVertex(index);
    const Corner corner = MakeCorner(index);
    strip_[0] = strip_[1];
    strip_[1] = strip_[2];
    strip_[2] = corner;
    if (++strip_length_ < 3) return {};
    const auto [a, b, c] = std::tuple(strip_[0].position, strip_[1].position, strip_[2].position);
    if (a == b || b == c || a == c) return {};
    Corner triangle[] = {strip_[0], strip_[1], strip_[2]};
    if (strip_length_ % 2 == 0) std::swap(triangle[0], triangle[1]);
    ++triangles_;
    return sink_.AddPolygon(
        triangle, tables_.textures.wanted ? tables_.textures.scene_index.front() : kNoIndex, kNoIndex);
  }

  const PlyHeader& header_;
  PlyRowReader<Source> rows_;
  ModelSink& sink_;
  const std::string& path_;
  uint64_t vertex_count_ = 0, triangles_ = 0, short_faces_ = 0;
  bool real_to_255_ = false;  ///< channels of real numbers run to 255
  bool has_normals_ = false, has_uvs_ = false, has_colors_ = false;
  bool has_uv_lists_ = false;
  uint32_t uv_count_ = 0;  ///< of corners
  PlyTables tables_;
  std::vector<Corner> corners_;
  Corner strip_[3];
  uint32_t strip_length_ = 0;
};

}  // namespace

Result<uint64_t> ImportPly(ModelReader& bytes, ModelSink& sink) { return ImportConverted(bytes, "", sink); }

Result<uint64_t> ImportConverted(ModelReader& bytes, const std::string& model, ModelSink& sink) {
  QUARRY_ASSIGN(const PlyHeader header, ReadPlyHeader(bytes));
  switch (header.encoding) {
    case PlyEncoding::kAscii:
      return PlyBody(header, AsciiPlySource(bytes, header.lines), model, sink).Import();
    case PlyEncoding::kBinaryLittleEndian:
      return PlyBody(header, BinaryPlySource<false>(bytes), model, sink).Import();
    case PlyEncoding::kBinaryBigEndian:
      break;
  }
  return PlyBody(header, BinaryPlySource<true>(bytes), model, sink).Import();
}

}  // namespace quarry
