// PLY after its header: elements in file order, each row read by a plan that is made once per element.
// Source: Turk, "The PLY Polygon File Format", 1994.

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <tuple>
#include <utility>

#include "common/scene/material_json.h"
#include "common/voxel/parts/part_path.h"
#include "preprocess/import/carried_fields.h"
#include "preprocess/import/file_color.h"
#include "preprocess/import/files/find_file.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/ply/library_textures.h"
#include "preprocess/import/ply/ply_row_reader.h"
#include "preprocess/import/ply/ply_textures.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

bool HasNoFaces(const PlyHeader& header) {
  const auto has = [&](const char* name) {
    const PlyElement* element = header.Find(name);
    return element != nullptr && element->count != 0;
  };
  return !has("face") && !has("tristrips");
}

/// Maps material_index or part_index to indices in the scene. `wanted`: the file has the property and the
/// list.
struct IndexTable {
  bool wanted = false;
  std::vector<uint32_t> scene_index;
};

template <typename Source>
class PlyBody {
 public:
  PlyBody(const PlyHeader& header, Source source, const std::string& model, ModelSink& sink)
      : header_(header), rows_(source), sink_(sink), path_(rows_.source.bytes().path()), model_(model) {}

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
    if (face) QUARRY_TRY(LoadTables(*face));
    QUARRY_TRY(LoadTextures());
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

  /// The materials' file; for "model.ply.gz" that of "model.ply".
  std::string LibraryPath() const {
    std::string path = MaterialJsonPath(
        rows_.source.bytes().is_packed() ? std::filesystem::path(path_).replace_extension().string() : path_);
    const auto found = FindFile(path_, std::filesystem::path(path).filename().string());
    return found.empty() ? path : found.string();
  }

  Status LoadTables(const PlyElement& face) {
    const PlyPlan plan = PlanFace(face);
    const bool materials = plan.Has(kMaterial, kMaterial), parts = plan.Has(kPart, kPart);
    if (!materials && !parts) return {};
    const std::string path = LibraryPath();
    struct stat info {};
    if (stat(path.c_str(), &info) != 0) {
      sink_.Warn(fmt::format(
          "{}: has material_index or part_index, but {} is not there, so they are left out", path_, path));
      return {};
    }
    QUARRY_ASSIGN(const MaterialLibrary library, ReadMaterialJson(path));
    CarriedFields left_out;
    for (const std::string& field : library.left_out) left_out.Names(FieldKind::kForeign, field);
    left_out.Warn(model_.empty() ? path_ : model_, sink_);
    materials_.wanted = materials;
    for (size_t i = 0; materials && i < library.materials.size(); ++i) {
      Material material = library.materials[i];
      QUARRY_TRY(
          AddLibraryTextures(library.images[i], path, model_.empty() ? path_ : model_, sink_, material));
      materials_.scene_index.push_back(sink_.AddMaterial(material));
    }
    parts_.wanted = parts && !library.parts.empty();
    for (const std::string& part : library.parts)
      if (parts) parts_.scene_index.push_back(PartOf(part));
    return {};
  }

  /// The part of a path; its ancestors are parts too.
  uint32_t PartOf(const std::string& path) {
    uint32_t part = kNoIndex;
    for (const std::string& name : NamesOfPath(path)) part = sink_.AddPart(name, part);
    return part;
  }

  Status LoadTextures() {
    if (header_.texture_files.empty() || materials_.wanted) return {};
    if (!has_uvs_ && !has_uv_lists_) {
      sink_.Warn(fmt::format("{}: names the image {} (TextureFile), but has no texture coordinates", path_,
                             Quoted(header_.texture_files.front())));
      return {};
    }
    QUARRY_ASSIGN(textures_.scene_index, AddPlyTextures(header_, path_, sink_));
    textures_.wanted = !textures_.scene_index.empty();
    return {};
  }

  bool HasCornerUvs() const { return has_uv_lists_ && rows_.row.uvs.size() == 2 * corners_.size(); }

  /// The material of a face's image: the only image, or that of the row's number; kNoIndex: the face has
  /// none.
  uint32_t TextureMaterial(const PlyPlan& plan) const {
    if (!textures_.wanted || (has_uv_lists_ && !HasCornerUvs())) return kNoIndex;
    const double number = plan.Has(kTextureNumber, kTextureNumber) ? rows_.row.values[kTextureNumber] : 0;
    const bool is_listed = number >= 0 && number < static_cast<double>(textures_.scene_index.size());
    return is_listed ? textures_.scene_index[static_cast<size_t>(number)] : kNoIndex;
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
      return rows_.Read(element, plan, [&] { return Vertex(plan); });
    }
    if (element.name == "face") {
      const PlyPlan plan = PlanFace(element);
      if (!plan.has_index_list)
        return rows_.source.FailHere("the element \"face\" has no list vertex_indices of an integer type");
      return rows_.Read(element, plan, [&] { return Face(plan); });
    }
    if (element.name == "tristrips") return Strips(element);
    return rows_.Read(element, PlanToSkip(element), [] { return Status(); });
  }

  Rgba8 RowColor(const PlyPlan& plan) {
    const bool real = plan.color_scale[0] == kScaleOfReal;
    if (real &&
        std::max({rows_.row.values[kRed], rows_.row.values[kGreen], rows_.row.values[kBlue]}) > kMostOfOne)
      real_to_255_ = true;
    const auto channel = [&](int i) {
      return rows_.row.values[kRed + i] * (real_to_255_ && real ? 1 : plan.color_scale[i]);
    };
    return FileColor(channel(0), channel(1), channel(2), plan.Has(kAlpha, kAlpha) ? channel(3) : 255);
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
    if (!Look(materials_, kMaterial, material)) return NotListed(materials_, kMaterial, "material_index");
    if (!Look(parts_, kPart, part)) return NotListed(parts_, kPart, "part_index");
    if (!materials_.wanted) material = TextureMaterial(plan);
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

  /// False: the table has no entry for the row's value.
  bool Look(const IndexTable& table, FaceSlot slot, uint32_t& index) const {
    index = kNoIndex;
    if (!table.wanted) return true;
    const double value = rows_.row.values[slot];
    const auto at = static_cast<size_t>(value >= 0 && value < 0x1p32 ? value : 0x1p32);
    if (at >= table.scene_index.size() || static_cast<double>(at) != value) return false;
    index = table.scene_index[at];
    return true;
  }

  tl::unexpected<Error> NotListed(const IndexTable& table, FaceSlot slot, const char* name) {
    return rows_.source.FailHere(fmt::format("face {} (counted from 0) has {} {}, but {} lists {}",
                                             rows_.row_number, name, rows_.row.values[slot], LibraryPath(),
                                             table.scene_index.size()));
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
    return sink_.AddPolygon(triangle, textures_.wanted ? textures_.scene_index.front() : kNoIndex, kNoIndex);
  }

  const PlyHeader& header_;
  PlyRowReader<Source> rows_;
  ModelSink& sink_;
  const std::string& path_;
  const std::string& model_;  ///< that was converted to this PLY; empty: none
  uint64_t vertex_count_ = 0, triangles_ = 0, short_faces_ = 0;
  bool real_to_255_ = false;  ///< channels of real numbers run to 255
  bool has_normals_ = false, has_uvs_ = false, has_colors_ = false;
  bool has_uv_lists_ = false;
  uint32_t uv_count_ = 0;  ///< of corners
  IndexTable materials_, parts_;
  IndexTable textures_;  ///< materials of the images that the header names
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
