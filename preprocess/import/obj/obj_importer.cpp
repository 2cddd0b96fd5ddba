// Wavefront OBJ: the polygons of the format. Other lines are ignored.

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/import/carried_fields.h"
#include "preprocess/import/file_color.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/obj/obj_materials.h"
#include "preprocess/import/text/line_reader.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

/// The number of elements of a kind so far, and the largest index referred to. A face may refer to later
/// elements, so only the file's end decides whether they exist.
struct IndexRange {
  const char* kind;
  uint64_t count = 0;
  uint64_t largest = 0;  ///< counted from 1; 0: none
  uint64_t largest_line = 0;
  std::optional<uint64_t> total;  ///< in the whole file, once CountAhead() was needed
  uint64_t dangling = 0;          ///< corners that name an element which the file lacks
};

/// A colour channel beyond this means that channels run to 255 from there on, instead of 1.
constexpr double kMostOfOne = 2;

/// Old programs write keywords in capitals. `lower`: the keyword in small letters.
bool IsInCapitals(std::string_view keyword, std::string& lower) {
  constexpr size_t kLongestKeyword = 8;
  if (keyword.size() > kLongestKeyword) return false;
  for (const char c : keyword) lower.push_back(c >= 'A' && c <= 'Z' ? static_cast<char>(c | 32) : c);
  return lower != keyword;
}

class ObjFile {
 public:
  ObjFile(ModelReader& bytes, ModelSink& sink)
      : bytes_(bytes), lines_(bytes), sink_(sink), materials_(bytes.path(), sink) {}

  Result<uint64_t> Import();

 private:
  Status Line(std::string_view keyword, TextCursor& rest);
  Status OtherLine(std::string_view keyword, TextCursor& rest);
  Status Position(TextCursor& rest);
  Status Normal(TextCursor& rest);
  Status Uv(TextCursor& rest);
  Status Face(TextCursor& rest);
  Status ReadCorner(TextCursor& rest, Corner& corner);
  /// Reads an index. An optional index is kNoIndex if it is absent, 0, or beyond the file's elements:
  /// exporters drop normals but keep the faces' references to them.
  Status Index(TextCursor& rest, IndexRange& range, bool optional, uint32_t& index);
  Status IndexFailure(const TextCursor& at, std::string_view trouble) const;
  void SetPart();
  void SetSmoothing(std::string_view group);
  /// Reads the rest of the file once more to count its normals and texture coordinates.
  Status CountAhead();
  /// Whether the file has the element number `value`, here or later.
  Result<bool> Exists(IndexRange& range, uint64_t value);
  void WarnOfDangling(const IndexRange& range);
  Status CheckRange(const IndexRange& range) const;

  ModelReader& bytes_;
  LineReader lines_;
  ModelSink& sink_;
  ObjMaterials materials_;
  CarriedFields fields_;
  IndexRange positions_{"vertex"}, normals_{"normal"}, uvs_{"texture coordinate"};
  std::vector<Corner> corners_;
  std::string object_, group_, material_name_;
  bool part_changed_ = false, material_changed_ = false;
  uint32_t part_ = kNoIndex, material_ = kNoIndex;
  uint64_t triangles_ = 0, short_faces_ = 0, free_forms_ = 0;
  double color_scale_ = 255;
  uint16_t smoothing_ = kSmoothByAngle;
  bool has_painted_ = false;  ///< colours in ZBrush's comments
};

Result<uint64_t> ObjFile::Import() {
  std::string_view line;
  while (true) {
    QUARRY_ASSIGN(const bool more, lines_.NextJoined(line));
    if (!more) break;
    TextCursor rest(line);
    const std::string_view keyword = rest.Word();
    QUARRY_TRY(Line(keyword, rest));
  }
  if (triangles_ == 0 && free_forms_ != 0)
    return Fail(
        fmt::format("{}: holds no polygons, but {} free-form curves or surfaces, which are not read; export "
                    "it as polygons",
                    bytes_.path(), free_forms_));
  if (positions_.count + short_faces_ == 0)
    return Fail(fmt::format(
        "{}: holds no triangles: it has no line of a vertex (v x y z), as an OBJ file has", bytes_.path()));
  if (triangles_ + short_faces_ == 0) return NoFaces(bytes_.path(), positions_.count);
  QUARRY_TRY(CheckRange(positions_));
  WarnOfDangling(normals_);
  WarnOfDangling(uvs_);
  if (has_painted_)
    sink_.Warn(fmt::format("{}: its colours are in comments (#MRGB, as ZBrush writes them); left out",
                           bytes_.path()));
  if (free_forms_ != 0)
    sink_.Warn(fmt::format("{}: {} free-form curves or surfaces left out", bytes_.path(), free_forms_));
  if (short_faces_ != 0)
    sink_.Warn(fmt::format("{}: {} faces of fewer than 3 corners left out", bytes_.path(), short_faces_));
  fields_.Warn(bytes_.path(), sink_);
  return triangles_;
}

Status ObjFile::Line(std::string_view keyword, TextCursor& rest) {
  if (keyword == "v") return Position(rest);
  if (keyword == "f" || keyword == "fo") return Face(rest);
  if (keyword == "vn") return Normal(rest);
  if (keyword == "vt") return Uv(rest);
  if (keyword.empty()) return {};
  if (keyword.front() == '#') {
    has_painted_ |= keyword == "#MRGB";
    return {};
  }
  return OtherLine(keyword, rest);
}

Status ObjFile::OtherLine(std::string_view keyword, TextCursor& rest) {
  if (keyword == "usemtl") {
    material_name_ = std::string(rest.Name());
    material_changed_ = true;
  } else if (keyword == "mtllib") {
    materials_.AddLibraries(rest.Name());
    material_changed_ = true;  // a missing material may be defined now
  } else if (keyword == "newmtl" && bytes_.can_reopen()) {
    materials_.AddOwn();
    material_changed_ = true;
  } else if (keyword == "o") {
    object_ = std::string(rest.Name());
    group_.clear();
    part_changed_ = true;
  } else if (keyword == "g") {
    group_ = std::string(rest.Name());
    part_changed_ = true;
  } else if (keyword == "s") {
    SetSmoothing(rest.Word());
  } else if (keyword.find('\0') != std::string_view::npos) {
    return lines_.FailHere("holds a zero byte, so this is not a text file of a model");
  } else if (keyword == "surf" || keyword == "curv" || keyword == "curv2") {
    ++free_forms_;
  } else if (std::string lower; IsInCapitals(keyword, lower)) {
    return Line(lower, rest);
  } else {
    fields_.Names(FieldKind::kObjStatement, keyword);
  }
  return {};
}

/// "s 3" begins a smoothing group; "s 0", "s off" and "s null" flat faces. Other words are passed over.
void ObjFile::SetSmoothing(std::string_view group) {
  TextCursor word(group);
  int64_t number = 0;
  if (ParseInteger(word, number) && number >= 0)
    smoothing_ = number == 0 ? kFlat : SmoothingGroup(static_cast<uint64_t>(number));
  else if (EqualsIgnoringCase(group, "off") || EqualsIgnoringCase(group, "null"))
    smoothing_ = kFlat;
  sink_.SetSmoothing(smoothing_);
}

Status ObjFile::Position(TextCursor& rest) {
  double value[7];
  int count = 0;
  while (count < 7 && !rest.AtEnd() && ParseReal(rest, value[count])) ++count;
  if (count < 3)
    return lines_.FailHere(rest.AtEnd() ? "a vertex needs three numbers"
                                        : fmt::format("{} is not a number", Quoted(rest.Word())));
  Rgba8 color;
  if (count >= 6) {  // four numbers are x y z w; w is the weight of a rational curve
    if (std::max({value[3], value[4], value[5]}) > kMostOfOne) color_scale_ = 1;
    color = FileColor(value[3] * color_scale_, value[4] * color_scale_, value[5] * color_scale_);
  }
  ++positions_.count;
  return sink_.AddPosition({value[0], value[1], value[2]}, color);
}

Status ObjFile::Normal(TextCursor& rest) {
  glm::dvec3 normal;
  for (int i = 0; i < 3; ++i)
    if (!ParseReal(rest, normal[i])) return lines_.FailHere("a normal needs three numbers");
  ++normals_.count;
  return sink_.AddNormal(glm::vec3(normal));
}

Status ObjFile::Uv(TextCursor& rest) {
  glm::dvec2 uv(0);
  if (!ParseReal(rest, uv.x)) return lines_.FailHere("a texture coordinate needs a number");
  if (!rest.AtEnd() && !ParseReal(rest, uv.y))
    return lines_.FailHere(fmt::format("{} is not a number", Quoted(rest.Word())));
  ++uvs_.count;
  return sink_.AddUv(glm::vec2(uv));
}

Status ObjFile::Face(TextCursor& rest) {
  corners_.clear();
  while (!rest.AtEnd()) {
    if (corners_.size() == kMaxPolygonCorners)
      return lines_.FailHere(fmt::format("the face has more than {} corners", kMaxPolygonCorners));
    Corner corner;
    QUARRY_TRY(ReadCorner(rest, corner));
    corners_.push_back(corner);
  }
  if (corners_.size() < 3) {
    ++short_faces_;
    return {};
  }
  if (part_changed_) SetPart();
  if (material_changed_) {
    material_ = kNoIndex;
    if (!material_name_.empty()) {
      QUARRY_ASSIGN(material_, materials_.Use(material_name_));
    }
    material_changed_ = false;
  }
  triangles_ += corners_.size() - 2;
  return sink_.AddPolygon(corners_, material_, part_);
}

/// Reads v, v/vt, v//vn or v/vt/vn.
Status ObjFile::ReadCorner(TextCursor& rest, Corner& corner) {
  QUARRY_TRY(Index(rest, positions_, false, corner.position));
  if (rest.next != rest.end && *rest.next == '/') {
    ++rest.next;
    QUARRY_TRY(Index(rest, uvs_, true, corner.uv));
  }
  if (rest.next != rest.end && *rest.next == '/') {
    ++rest.next;
    QUARRY_TRY(Index(rest, normals_, true, corner.normal));
  }
  if (rest.next != rest.end && !IsSpace(*rest.next) && *rest.next != '#')
    return IndexFailure(rest, "is not part of an index");
  return {};
}

Status ObjFile::Index(TextCursor& rest, IndexRange& range, bool optional, uint32_t& index) {
  if (optional && (rest.next == rest.end || *rest.next == '/' || IsSpace(*rest.next))) return {};
  const TextCursor start = rest;
  int64_t value;
  if (!ParseInteger(rest, value)) return IndexFailure(start, "is not an index");
  if (value == 0 && optional) return {};  // some exporters write 0 for none
  if (value == 0) return IndexFailure(start, "refers to vertex 0, but OBJ counts from 1");
  if (value < 0) value += static_cast<int64_t>(range.count) + 1;
  if (value <= 0)
    return IndexFailure(start,
                        fmt::format("reaches before the first {} of the {} so far", range.kind, range.count));
  if (value >= int64_t{kNoIndex})
    return IndexFailure(start, "is beyond the 4,294,967,294 elements a file may have");
  if (optional && static_cast<uint64_t>(value) > range.count) [[unlikely]] {
    QUARRY_ASSIGN(const bool exists, Exists(range, static_cast<uint64_t>(value)));
    if (!exists) return {};
  }
  if (static_cast<uint64_t>(value) > range.largest) {
    range.largest = static_cast<uint64_t>(value);
    range.largest_line = lines_.line_number();
  }
  index = static_cast<uint32_t>(value - 1);
  return {};
}

Result<bool> ObjFile::Exists(IndexRange& range, uint64_t value) {
  if (!range.total) QUARRY_TRY(CountAhead());
  if (value > *range.total) ++range.dangling;
  return value <= *range.total;
}

Status ObjFile::CountAhead() {
  normals_.total = normals_.count;
  uvs_.total = uvs_.count;
  if (!bytes_.can_reopen()) return {};  // later elements cannot be counted
  QUARRY_ASSIGN(ModelReader ahead, ModelReader::Open(bytes_.path(), bytes_.unpack_limit()));
  if (!ahead.Skip(bytes_.offset())) return {};
  LineReader lines(ahead);
  std::string_view line;
  while (true) {
    QUARRY_ASSIGN(const bool more, lines.NextJoined(line));
    if (!more) return {};
    const std::string_view keyword = TextCursor(line).Word();
    *normals_.total += EqualsIgnoringCase(keyword, "vn");
    *uvs_.total += EqualsIgnoringCase(keyword, "vt");
  }
}

Status ObjFile::IndexFailure(const TextCursor& at, std::string_view trouble) const {
  TextCursor word = at;
  return lines_.FailHere(fmt::format("{} in a face {}", Quoted(word.Word()), trouble));
}

void ObjFile::SetPart() {
  part_ = object_.empty() ? kNoIndex : sink_.AddPart(object_, kNoIndex);
  if (!group_.empty() && group_ != object_) part_ = sink_.AddPart(group_, part_);
  part_changed_ = false;
}

void ObjFile::WarnOfDangling(const IndexRange& range) {
  if (range.dangling == 0) return;
  sink_.Warn(fmt::format("{}: {} corners refer to a {} that is not among the {} in the file; left out",
                         bytes_.path(), range.dangling, range.kind, range.count));
}

Status ObjFile::CheckRange(const IndexRange& range) const {
  if (range.largest <= range.count) return {};
  return Fail(fmt::format("{}, line {}: the face refers to {} {}, but the file has only {}", bytes_.path(),
                          range.largest_line, range.kind, range.largest, range.count));
}

/// Words that begin lines of OBJ files and of few others.
bool IsObjKeyword(std::string_view word) {
  constexpr std::string_view kWords[] = {"v", "vn", "vt", "f", "o", "g", "s", "mtllib", "usemtl"};
  return std::ranges::find(kWords, word) != std::end(kWords);
}

}  // namespace

bool LooksLikeObj(ModelReader& bytes) {
  bytes.Ensure(ModelReader::kBufferBytes);
  std::string_view text = bytes.view();
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  bool library = false;
  while (!text.empty()) {
    const std::string_view line = text.substr(0, text.find_first_of("\r\n"));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    const std::string_view word = TextCursor(line).Word();
    library = library || EqualsIgnoringCase(word, "newmtl");
    if (library && word != "v") continue;  // materials may stand before the model, in its own file
    if (!word.empty() && !word.starts_with('#')) return IsObjKeyword(word);
  }
  return false;
}

Result<uint64_t> ImportObj(ModelReader& bytes, ModelSink& sink) { return ObjFile(bytes, sink).Import(); }

}  // namespace quarry
