// OFF, ASCII: OFF, COFF, NOFF, STOFF and combinations. Three or four numbers after a face's corners are its
// colour; after a vertex, too, even without the C in the keyword.

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "preprocess/import/file_color.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/text/line_reader.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

/// The values of a vertex's line, by the letters before "OFF".
struct Layout {
  bool uv = false, color = false, normal = false, four = false, ndim = false;
};

/// Reads the keyword, which the first count may follow without a blank ("OFF4 2 0"). The letters before OFF
/// stand in the format's order. False, and nothing is read: other text.
bool ParseKeyword(TextCursor& cursor, Layout& layout) {
  TextCursor after = cursor;
  std::string_view word = after.Word();
  const size_t keyword = std::min(word.find("OFF"), word.find("off"));
  const size_t digits = std::min(word.find_first_of("0123456789", keyword), word.size());
  after.next -= word.size() - digits;
  // Letters may be small, except n, which means another dimension.
  std::string capitals(word.substr(0, digits));
  if (capitals.ends_with("off"))
    std::ranges::transform(capitals, capitals.begin(),
                           [](char c) { return c >= 'a' && c <= 'z' ? c & ~32 : c; });
  word = capitals;
  if (!word.ends_with("OFF")) return false;
  word.remove_suffix(3);
  const auto take = [&](std::string_view letters) {
    if (!word.starts_with(letters)) return false;
    word.remove_prefix(letters.size());
    return true;
  };
  layout.uv = take("ST");
  layout.color = take("C");
  layout.normal = take("N");
  layout.four = take("4");
  layout.ndim = take("n");
  if (word.empty()) cursor = after;
  return word.empty();
}

class OffFile {
 public:
  OffFile(ModelReader& bytes, ModelSink& sink) : bytes_(bytes), lines_(bytes), sink_(sink) {}

  Result<uint64_t> Import() {
    QUARRY_TRY(Header());
    if (vertices_ != 0 && faces_ == 0) return NoFaces(bytes_.path(), vertices_);
    for (uint64_t i = 0; i < vertices_; ++i) QUARRY_TRY(Vertex(i));
    for (uint64_t i = 0; i < faces_; ++i) QUARRY_TRY(Face(i));
    return triangles_;
  }

 private:
  /// The next line that is neither empty nor a comment.
  Result<TextCursor> NextLine(const char* kind, uint64_t index) {
    std::string_view line;
    for (;;) {
      QUARRY_ASSIGN(const bool more, lines_.Next(line));
      if (!more) return lines_.FailHere(fmt::format("the file ends where {} {} should be", kind, index));
      TextCursor cursor(line);
      if (!cursor.AtEnd()) return cursor;
    }
  }

  Status Header() {
    QUARRY_ASSIGN(TextCursor cursor, NextLine("the counts, line", 1));
    ParseKeyword(cursor, layout_);  // the keyword is optional
    if (layout_.four || layout_.ndim)
      return lines_.FailHere("OFF is read in 3 dimensions only; write it with three coordinates");
    if (cursor.AtEnd()) {
      QUARRY_ASSIGN(cursor, NextLine("the counts, line", 2));
    }
    if (TextCursor binary = cursor; binary.Word() == "BINARY")
      return lines_.FailHere("binary OFF is not read; convert it to ASCII");
    int64_t counts[2];
    for (int64_t& count : counts) {
      cursor.SkipBlanks();
      if (!ParseInteger(cursor, count) || count < 0 || count > 0xFFFFFFFF)
        return lines_.FailHere("the numbers of vertices and faces should be here");
    }
    vertices_ = static_cast<uint64_t>(counts[0]);
    faces_ = static_cast<uint64_t>(counts[1]);
    return {};
  }

  Status Vertex(uint64_t index) {
    QUARRY_ASSIGN(TextCursor cursor, NextLine("vertex", index));
    glm::dvec3 position;
    for (int a = 0; a < 3; ++a)
      if (!ParseReal(cursor, position[a])) return lines_.FailHere("a vertex needs three numbers");
    if (layout_.normal) {
      glm::dvec3 normal;
      for (int a = 0; a < 3; ++a)
        if (!ParseReal(cursor, normal[a])) return lines_.FailHere("a normal needs three numbers");
      QUARRY_TRY(sink_.AddNormal(glm::vec3(normal)));
    }
    Rgba8 color;
    if (layout_.color) QUARRY_TRY(VertexColor(cursor, color));
    if (layout_.uv) {
      glm::dvec2 uv;
      for (int a = 0; a < 2; ++a)
        if (!ParseReal(cursor, uv[a])) return lines_.FailHere("a texture coordinate needs two numbers");
      QUARRY_TRY(sink_.AddUv(glm::vec2(uv)));
    }
    if (!layout_.color && OptionalColor(cursor, color)) vertex_colors_ = true;
    return sink_.AddPosition(position, color);
  }

  Status VertexColor(TextCursor& cursor, Rgba8& color) {
    vertex_colors_ = true;
    if (ReadColor(cursor, layout_.uv ? 3 : 4, color)) return {};
    return lines_.FailHere("a vertex's colour needs three or four numbers");
  }

  /// Whether the rest of the line is a colour; sets it.
  static bool OptionalColor(TextCursor cursor, Rgba8& color) {
    if (cursor.AtEnd()) return false;
    return ReadColor(cursor, 4, color) && cursor.AtEnd();
  }

  /// Reads 3 or, up to `most`, 4 numbers: 0 to 255 if all are whole, else 0 to 1.
  static bool ReadColor(TextCursor& cursor, int most, Rgba8& color) {
    double values[4] = {0, 0, 0, 1};
    bool whole = true;
    for (int i = 0; i < most; ++i) {
      if (i == 3 && cursor.AtEnd()) break;
      TextCursor text = cursor;
      if (!ParseReal(cursor, values[i]) || !(values[i] >= 0)) return false;
      whole &= text.Word().find_first_of(".eE") == std::string_view::npos;
    }
    const double scale = whole && *std::max_element(values, values + 3) > 1 ? 1 : 255;
    color = FileColor(values[0] * scale, values[1] * scale, values[2] * scale);
    return true;
  }

  Status Face(uint64_t index) {
    QUARRY_ASSIGN(TextCursor cursor, NextLine("face", index));
    int64_t count = 0;
    if (!ParseInteger(cursor, count) || count < 0)
      return lines_.FailHere("a face begins with its number of corners");
    if (count > static_cast<int64_t>(kMaxPolygonCorners))
      return lines_.FailHere(fmt::format("the face has more than {} corners", kMaxPolygonCorners));
    corners_.clear();
    for (int64_t i = 0; i < count; ++i) {
      int64_t vertex = 0;
      if (cursor.AtEnd()) {
        QUARRY_ASSIGN(cursor, NextLine("the rest of face", index));
      }
      if (!ParseInteger(cursor, vertex))
        return lines_.FailHere(fmt::format("the face should have {} corners, but has {}", count, i));
      if (vertex < 0 || static_cast<uint64_t>(vertex) >= vertices_)
        return lines_.FailHere(
            fmt::format("the face refers to vertex {}, but the file has only {}, from 0", vertex, vertices_));
      const auto at = static_cast<uint32_t>(vertex);
      corners_.push_back({at, layout_.normal ? at : kNoIndex, layout_.uv ? at : kNoIndex});
    }
    Rgba8 color;
    const bool colored =
        !vertex_colors_ && OptionalColor(cursor, color);  // vertices' colours take precedence
    if (colored || face_colors_) QUARRY_TRY(sink_.SetFaceColor(color));
    face_colors_ |= colored;
    if (count < 3) return {};
    triangles_ += static_cast<uint64_t>(count) - 2;
    return sink_.AddPolygon(corners_, kNoIndex, kNoIndex);
  }

  ModelReader& bytes_;
  LineReader lines_;
  ModelSink& sink_;
  Layout layout_;
  uint64_t vertices_ = 0, faces_ = 0, triangles_ = 0;
  bool vertex_colors_ = false, face_colors_ = false;  ///< whether any was met
  std::vector<Corner> corners_;
};

}  // namespace

bool LooksLikeOff(ModelReader& bytes) {
  const std::string_view text = BehindComments(bytes);
  TextCursor cursor(text.substr(0, text.find_first_of("\r\n")));
  Layout layout;
  return ParseKeyword(cursor, layout);
}

Result<uint64_t> ImportOff(ModelReader& bytes, ModelSink& sink) { return OffFile(bytes, sink).Import(); }

}  // namespace quarry
