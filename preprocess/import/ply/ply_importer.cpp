// PLY after its header: the elements in file order, each row through a plan made once per element.
// The format: Turk, "The PLY Polygon File Format", 1994.

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <tuple>
#include <utility>

#include "common/scene/material_json.h"
#include "preprocess/import/checkpoint.h"
#include "preprocess/import/file_color.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/ply/ply_plan.h"
#include "preprocess/import/ply/ply_rows.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

constexpr uint64_t kRowsPerLook = 256;  // whether a checkpoint is due

bool HasNoFaces(const PlyHeader& header) {
  const auto has = [&](const char* name) {
    const PlyElement* element = header.Find(name);
    return element != nullptr && element->count != 0;
  };
  return !has("face") && !has("tristrips");
}

/// What material_index and part_index stand for in the scene; `wanted` if the file has the property and the
/// list.
struct IndexTable {
  bool wanted = false;
  std::vector<uint32_t> scene_index;

  void Save(ByteWriter& out) const {
    out.Put<uint8_t>(wanted);
    out.Put(static_cast<uint32_t>(scene_index.size()));
    out.PutArray(scene_index);
  }
  void Restore(ByteReader& in) {
    wanted = in.Get<uint8_t>() != 0;
    scene_index = in.GetArray<uint32_t>(in.Get<uint32_t>());
  }
};

template <typename Source>
class PlyBody {
 public:
  PlyBody(const PlyHeader& header, Source source, ModelSink& sink)
      : header_(header), source_(source), sink_(sink), path_(source_.bytes().path()) {}

  Result<uint64_t> Import();
  void Save(ByteWriter& out) const;
  Status Restore(ByteReader& in);

 private:
  /// Of "model.ply.gz" too that of "model.ply".
  std::string LibraryPath() {
    return MaterialJsonPath(
        source_.bytes().is_packed() ? std::filesystem::path(path_).replace_extension().string() : path_);
  }
  Status LoadTables(const PlyElement& face);
  Status Element(const PlyElement& element);
  Status Vertices(const PlyElement& element);
  Status Faces(const PlyElement& element);
  Status Strips(const PlyElement& element);
  Status OtherRows(const PlyElement& element);

  /// Reads all rows of `element` by `plan` and gives each to `use` (a Status of the row).
  template <typename Use>
  Status Rows(const PlyElement& element, const PlyPlan& plan, Use&& use);
  template <typename Use>
  Status FixedRows(const PlyElement& element, const PlyPlan& plan, Use&& use);
  template <typename Use>
  Status RowsOneByOne(const PlyElement& element, const PlyPlan& plan, Use&& use);
  bool ReadTriangle(const PlyPlan& plan);
  bool ReadStep(const PlyStep& step);
  bool ReadIndexList(const PlyStep& step);

  Rgba8 RowColor(const PlyPlan& plan);
  Status Vertex(const PlyPlan& plan);
  Status Face(const PlyPlan& plan);
  bool IsVertex(int64_t index) const {
    return index >= 0 && static_cast<uint64_t>(index) < vertex_count_ && index < int64_t{kNoIndex};
  }
  tl::unexpected<Error> NoVertex(int64_t index) const;
  Corner MakeCorner(int64_t index) const;
  bool Look(const IndexTable& table, FaceSlot slot, uint32_t& index) const;
  tl::unexpected<Error> NotListed(const IndexTable& table, FaceSlot slot, const char* name);
  Status StripList(const PlyElement& element, const PlyStep& step);
  Status StripIndex(int64_t index);
  tl::unexpected<Error> RowFailure(const PlyElement& element) const;

  const PlyHeader& header_;
  Source source_;
  ModelSink& sink_;
  const std::string& path_;
  PlyRow row_;
  size_t element_ = 0;       ///< being read
  uint64_t row_number_ = 0;  ///< of it
  std::string complaint_;    ///< Why a step failed, where the source itself had nothing to object to.
  uint64_t vertex_count_ = 0, triangles_ = 0, short_faces_ = 0, long_rows_ = 0;
  bool real_to_255_ = false;  ///< colours of real numbers
  bool has_normals_ = false, has_uvs_ = false, has_colors_ = false;
  IndexTable materials_, parts_;
  std::vector<Corner> corners_;
  Corner strip_[3];
  uint32_t strip_length_ = 0;
};

template <typename Source>
Result<uint64_t> PlyBody<Source>::Import() {
  const PlyElement* vertex = header_.Find("vertex");
  if (vertex == nullptr) return source_.FailHere("the PLY header has no element \"vertex\"");
  vertex_count_ = vertex->count;
  const PlyPlan plan = PlanVertex(*vertex);
  if (!plan.Has(kX, kZ)) return source_.FailHere("the element \"vertex\" lacks x, y or z");
  if (HasNoFaces(header_) &&
      std::ranges::find(vertex->properties, "f_dc_0", &PlyProperty::name) != vertex->properties.end())
    return Fail(
        fmt::format("{}: holds {} Gaussian splats and no faces: there is no surface to trace; make a mesh of "
                    "them first",
                    path_, vertex_count_));
  if (HasNoFaces(header_) && vertex_count_ != 0) return NoFaces(path_, vertex_count_);
  has_normals_ = plan.Has(kNx, kNz);
  has_uvs_ = plan.Has(kU, kV);
  has_colors_ = plan.Has(kRed, kBlue);
  QUARRY_ASSIGN(const bool goes_on, GoOnFromCheckpoint(sink_, path_, *this));
  if (const PlyElement* face = header_.Find("face"); face && !goes_on) QUARRY_TRY(LoadTables(*face));
  if (!header_.texture_file.empty() && !goes_on)
    sink_.Warn(fmt::format("{}: names the image {} (TextureFile), which is left out", path_,
                           Quoted(header_.texture_file)));
  uint64_t rows = 0;
  for (const PlyElement& element : header_.elements) rows += element.properties.empty() ? 0 : element.count;
  if (!goes_on) source_.LookForRows(rows);
  for (; element_ < header_.elements.size(); ++element_) {
    QUARRY_TRY(Element(header_.elements[element_]));
    row_number_ = 0;
  }
  if (long_rows_ != 0)
    sink_.Warn(fmt::format("{}: {} lines hold more values than the header names; the rest is left out", path_,
                           long_rows_));
  if (short_faces_ != 0)
    sink_.Warn(fmt::format("{}: {} faces of fewer than 3 corners left out", path_, short_faces_));
  return triangles_;
}

template <typename Source>
void PlyBody<Source>::Save(ByteWriter& out) const {
  for (const uint64_t n : {source_.bytes().offset(), source_.line(), uint64_t{element_}, row_number_,
                           triangles_, short_faces_, long_rows_})
    out.Put(n);
  out.Put<uint8_t>(source_.by_line());
  out.Put<uint8_t>(real_to_255_);
  materials_.Save(out);
  parts_.Save(out);
}

template <typename Source>
Status PlyBody<Source>::Restore(ByteReader& in) {
  QUARRY_TRY(source_.bytes().SkipTo(in.Get<uint64_t>()));
  source_.GoOnAtLine(in.Get<uint64_t>());
  element_ = in.Get<uint64_t>();
  row_number_ = in.Get<uint64_t>();
  triangles_ = in.Get<uint64_t>();
  short_faces_ = in.Get<uint64_t>();
  long_rows_ = in.Get<uint64_t>();
  source_.SetByLine(in.Get<uint8_t>() != 0);
  real_to_255_ = in.Get<uint8_t>() != 0;
  materials_.Restore(in);
  parts_.Restore(in);
  return {};
}

template <typename Source>
Status PlyBody<Source>::LoadTables(const PlyElement& face) {
  const PlyPlan plan = PlanFace(face);
  const bool materials = plan.Has(kMaterial, kMaterial), parts = plan.Has(kPart, kPart);
  if (!materials && !parts) return {};
  const std::string path = LibraryPath();
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) {
    sink_.Warn(fmt::format("{}: has material_index or part_index, but {} is not there; they are left out",
                           path_, path));
    return {};
  }
  QUARRY_ASSIGN(const MaterialLibrary library, ReadMaterialJson(path));
  materials_.wanted = materials;
  for (const Material& material : library.materials)
    if (materials) materials_.scene_index.push_back(sink_.AddMaterial(material));
  parts_.wanted = parts && !library.parts.empty();
  for (const std::string& part : library.parts)
    if (parts) parts_.scene_index.push_back(sink_.AddPart(part));
  return {};
}

template <typename Source>
Status PlyBody<Source>::Element(const PlyElement& element) {
  if (element.properties.empty()) return {};  // rows of nothing, however many are claimed
  if (element.name == "vertex") return Vertices(element);
  if (element.name == "face") return Faces(element);
  if (element.name == "tristrips") return Strips(element);
  return OtherRows(element);
}

template <typename Source>
Status PlyBody<Source>::Vertices(const PlyElement& element) {
  const PlyPlan plan = PlanVertex(element);
  return Rows(element, plan, [&] { return Vertex(plan); });
}

template <typename Source>
Status PlyBody<Source>::Faces(const PlyElement& element) {
  const PlyPlan plan = PlanFace(element);
  if (!plan.has_index_list)
    return source_.FailHere("the element \"face\" has no list vertex_indices of an integer type");
  return Rows(element, plan, [&] { return Face(plan); });
}

template <typename Source>
Status PlyBody<Source>::OtherRows(const PlyElement& element) {
  return Rows(element, PlanToSkip(element), [] { return Status(); });
}

template <typename Source>
template <typename Use>
Status PlyBody<Source>::Rows(const PlyElement& element, const PlyPlan& plan, Use&& use) {
  if constexpr (Source::kBinary)
    if (!plan.has_lists) return FixedRows(element, plan, use);
  return RowsOneByOne(element, plan, use);
}

/// Binary rows without lists: values lie at fixed offsets, so a buffer full of rows goes through one loop.
template <typename Source>
template <typename Use>
Status PlyBody<Source>::FixedRows(const PlyElement& element, const PlyPlan& plan, Use&& use) {
  struct Wanted {
    uint32_t offset;
    PlyType type;
    uint8_t slot;
  };
  std::vector<Wanted> wanted;
  uint32_t stride = 0;
  for (const PlyStep& step : plan.steps) {
    if (step.target != PlyStep::kSkip) wanted.push_back({stride, step.type, step.target});
    stride += SizeOf(step.type);
  }
  ModelReader& bytes = source_.bytes();
  if (element.count - row_number_ > bytes.remaining() / stride)
    return source_.FailHere(fmt::format(
        "the header promises {} rows of {} bytes for the element {}, but the file has {} bytes left",
        element.count - row_number_, stride, element.name, bytes.remaining()));
  if (wanted.empty() && bytes.Skip(element.count * stride)) return {};
  for (; row_number_ < element.count; ++row_number_) {
    if (row_number_ % kRowsPerLook == 0) QUARRY_TRY(CheckpointIfDue(sink_, *this));
    if (!bytes.Ensure(stride)) return RowFailure(element);
    const char* at = bytes.data();
    for (const Wanted& want : wanted) row_.values[want.slot] = Source::Load(at + want.offset, want.type);
    bytes.Consume(stride);
    QUARRY_TRY(use());
  }
  return {};
}

template <typename Source>
template <typename Use>
Status PlyBody<Source>::RowsOneByOne(const PlyElement& element, const PlyPlan& plan, Use&& use) {
  for (; row_number_ < element.count; ++row_number_) {
    if (row_number_ % kRowsPerLook == 0) QUARRY_TRY(CheckpointIfDue(sink_, *this));
    if (!ReadTriangle(plan))
      for (const PlyStep& step : plan.steps) {
        if (ReadStep(step)) [[likely]]
          continue;
        return RowFailure(element);
      }
    long_rows_ += source_.EndRow();
    QUARRY_TRY(use());
  }
  return {};
}

/// A row of the usual form at once: a byte 3, three indices of 32 bits, scalars. False, and nothing is read,
/// if the row is of another.
template <typename Source>
bool PlyBody<Source>::ReadTriangle(const PlyPlan& plan) {
  if constexpr (!Source::kBinary) {
    return false;
  } else {
    if (plan.triangle_bytes == 0 || !source_.bytes().Ensure(plan.triangle_bytes)) return false;
    const char* at = source_.bytes().data();
    if (*at != 3) return false;
    const PlyType type = plan.steps[0].type;
    row_.indices.resize(3);
    for (size_t k = 0; k < 3; ++k) row_.indices[k] = static_cast<int64_t>(Source::Load(at + 1 + 4 * k, type));
    at += 13;
    for (size_t i = 1; i < plan.steps.size(); ++i) {
      const PlyStep& step = plan.steps[i];
      if (step.target != PlyStep::kSkip) row_.values[step.target] = Source::Load(at, step.type);
      at += SizeOf(step.type);
    }
    source_.bytes().Consume(plan.triangle_bytes);
    return true;
  }
}

template <typename Source>
bool PlyBody<Source>::ReadStep(const PlyStep& step) {
  if (step.target == PlyStep::kIndexList) return ReadIndexList(step);
  if (!step.count_type) {
    double ignored;
    return source_.Scalar(step.type, step.target == PlyStep::kSkip ? ignored : row_.values[step.target]);
  }
  int64_t count;
  if (!source_.Integer(*step.count_type, count)) return false;
  if (count < 0) complaint_ = " has a list of a negative length";
  return count >= 0 && source_.SkipValues(step.type, static_cast<uint64_t>(count));
}

template <typename Source>
bool PlyBody<Source>::ReadIndexList(const PlyStep& step) {
  row_.indices.clear();
  int64_t count;
  if (!source_.Integer(*step.count_type, count)) return false;
  if (count < 0 || static_cast<uint64_t>(count) > kMaxPolygonCorners) {
    complaint_ = fmt::format(" has {} corners, where 0 to {} are possible", count, kMaxPolygonCorners);
    return false;
  }
  return source_.Integers(step.type, static_cast<uint64_t>(count), row_.indices);
}

template <typename Source>
Rgba8 PlyBody<Source>::RowColor(const PlyPlan& plan) {
  const bool real = plan.color_scale[0] == kScaleOfReal;
  if (real && std::max({row_.values[kRed], row_.values[kGreen], row_.values[kBlue]}) > kMostOfOne)
    real_to_255_ = true;
  const auto channel = [&](int i) {
    return row_.values[kRed + i] * (real_to_255_ && real ? 1 : plan.color_scale[i]);
  };
  return FileColor(channel(0), channel(1), channel(2), plan.Has(kAlpha, kAlpha) ? channel(3) : 255);
}

template <typename Source>
Status PlyBody<Source>::Vertex(const PlyPlan& plan) {
  const double* value = row_.values;
  const Rgba8 color = plan.Has(kRed, kBlue) ? RowColor(plan) : Rgba8{};
  QUARRY_TRY(sink_.AddPosition({value[kX], value[kY], value[kZ]}, color));
  if (has_normals_) QUARRY_TRY(sink_.AddNormal(glm::vec3(value[kNx], value[kNy], value[kNz])));
  if (has_uvs_) QUARRY_TRY(sink_.AddUv(glm::vec2(value[kU], value[kV])));
  return {};
}

template <typename Source>
Status PlyBody<Source>::Face(const PlyPlan& plan) {
  if (row_.indices.size() < 3) {
    ++short_faces_;
    return {};
  }
  corners_.clear();
  for (const int64_t index : row_.indices) {
    if (!IsVertex(index)) return NoVertex(index);
    corners_.push_back(MakeCorner(index));
  }
  uint32_t material, part;
  if (!Look(materials_, kMaterial, material)) return NotListed(materials_, kMaterial, "material_index");
  if (!Look(parts_, kPart, part)) return NotListed(parts_, kPart, "part_index");
  triangles_ += corners_.size() - 2;
  // Where vertices have colours too, theirs are finer.
  if (!has_colors_ && plan.Has(kRed, kBlue)) QUARRY_TRY(sink_.SetFaceColor(RowColor(plan)));
  return sink_.AddPolygon(corners_, material, part);
}

template <typename Source>
tl::unexpected<Error> PlyBody<Source>::NoVertex(int64_t index) const {
  return source_.FailHere(
      fmt::format("face {} (counted from 0) refers to vertex {}, but there are {} vertices", row_number_,
                  index, vertex_count_));
}

template <typename Source>
Corner PlyBody<Source>::MakeCorner(int64_t index) const {
  const auto i = static_cast<uint32_t>(index);
  return Corner{i, has_normals_ ? i : kNoIndex, has_uvs_ ? i : kNoIndex};
}

/// False: the row's value names nothing in the table.
template <typename Source>
bool PlyBody<Source>::Look(const IndexTable& table, FaceSlot slot, uint32_t& index) const {
  index = kNoIndex;
  if (!table.wanted) return true;
  const double value = row_.values[slot];
  const auto at = static_cast<size_t>(value >= 0 && value < 0x1p32 ? value : 0x1p32);
  if (at >= table.scene_index.size() || static_cast<double>(at) != value) return false;
  index = table.scene_index[at];
  return true;
}

template <typename Source>
tl::unexpected<Error> PlyBody<Source>::NotListed(const IndexTable& table, FaceSlot slot, const char* name) {
  return source_.FailHere(fmt::format("face {} (counted from 0) has {} {}, but {} lists {}", row_number_,
                                      name, row_.values[slot], LibraryPath(), table.scene_index.size()));
}

/// A strip may be the whole model in one list, so it is read piece by piece.
template <typename Source>
Status PlyBody<Source>::Strips(const PlyElement& element) {
  const PlyPlan plan = PlanFace(element);
  for (; row_number_ < element.count; ++row_number_) {
    QUARRY_TRY(CheckpointIfDue(sink_, *this));
    strip_length_ = 0;
    for (const PlyStep& step : plan.steps) {
      if (step.target == PlyStep::kIndexList)
        QUARRY_TRY(StripList(element, step));
      else if (!ReadStep(step))
        return RowFailure(element);
    }
  }
  return {};
}

template <typename Source>
Status PlyBody<Source>::StripList(const PlyElement& element, const PlyStep& step) {
  int64_t left;
  if (!source_.Integer(*step.count_type, left)) return RowFailure(element);
  while (left > 0) {
    const int64_t piece = std::min<int64_t>(left, 4096);
    row_.indices.clear();
    if (!source_.Integers(step.type, static_cast<uint64_t>(piece), row_.indices)) return RowFailure(element);
    for (const int64_t index : row_.indices) QUARRY_TRY(StripIndex(index));
    left -= piece;
  }
  return {};
}

/// -1 starts a new strip. Every other triangle turns the other way round, and is turned back; those that only
/// join two strips, with a corner twice, are left out.
template <typename Source>
Status PlyBody<Source>::StripIndex(int64_t index) {
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
  return sink_.AddPolygon(triangle, kNoIndex, kNoIndex);
}

template <typename Source>
tl::unexpected<Error> PlyBody<Source>::RowFailure(const PlyElement& element) const {
  const std::string row =
      fmt::format("{} {} (counted from 0) of {}", element.name, row_number_, element.count);
  return complaint_.empty() ? source_.Failure(row) : source_.FailHere(row + complaint_);
}

}  // namespace

Result<uint64_t> ImportPly(ModelReader& bytes, ModelSink& sink) {
  QUARRY_ASSIGN(const PlyHeader header, ReadPlyHeader(bytes));
  switch (header.encoding) {
    case PlyEncoding::kAscii:
      return PlyBody(header, AsciiPlySource(bytes, header.lines), sink).Import();
    case PlyEncoding::kBinaryLittleEndian:
      return PlyBody(header, BinaryPlySource<false>(bytes), sink).Import();
    case PlyEncoding::kBinaryBigEndian:
      break;
  }
  return PlyBody(header, BinaryPlySource<true>(bytes), sink).Import();
}

}  // namespace quarry
