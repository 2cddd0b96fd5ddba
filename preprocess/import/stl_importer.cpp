// STL, ASCII and binary. Facet normals are ignored: each triangle has its own.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "preprocess/import/file_color.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/row_chunk.h"
#include "preprocess/import/text/line_reader.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

constexpr uint64_t kHeaderBytes = 84;  ///< 80 of text, 4 of count
constexpr uint64_t kFacetBytes = 50;   ///< a normal and three corners of 12 bytes, 2 bytes of attributes

uint64_t PromisedBytes(ModelReader& bytes) {
  uint32_t count;
  std::memcpy(&count, bytes.data() + kHeaderBytes - 4, sizeof count);
  return kHeaderBytes + kFacetBytes * count;
}

/// The header's count of facets. Some programs write the header first and never fill in the count: 0, or all
/// bits set.
uint32_t CountOf(ModelReader& bytes) {
  uint32_t count;
  std::memcpy(&count, bytes.data() + kHeaderBytes - 4, sizeof count);
  return count;
}
bool IsCount(uint32_t count) { return count != 0 && count != 0xFFFFFFFFu; }

/// The position of `word` in `text`, between blanks, in any case; npos: absent.
size_t FindWord(std::string_view text, std::string_view word) {
  for (size_t at = 0; at + word.size() <= text.size(); ++at)
    if ((at == 0 || IsSpace(text[at - 1])) && EqualsIgnoringCase(text.substr(at, word.size()), word) &&
        (at + word.size() == text.size() || IsSpace(text[at + word.size()])))
      return at;
  return text.npos;
}

bool SizeIsBinary(ModelReader& bytes) {
  return bytes.has_size() && bytes.Ensure(kHeaderBytes) && PromisedBytes(bytes) == bytes.size();
}

/// Programs write "solid" into binary headers too; a zero byte near the start shows them, unless facets
/// follow. The first line may be missing.
bool LooksAscii(ModelReader& bytes) {
  std::string_view text = BehindComments(bytes);
  const bool solid = text.size() >= 5 && EqualsIgnoringCase(text.substr(0, 5), "solid");
  const size_t facet = FindWord(text, "facet");
  if (!solid && (facet != 0 || FindWord(text, "outer") == text.npos)) return false;
  if (facet != text.npos) text.remove_prefix(facet);
  return text.find('\0') == text.npos;
}

/// Binary facets, at most: indices of their corners are 32 bits.
constexpr uint64_t kMostFacets = (kNoIndex - 1) / 3;

uint16_t AttributesOf(const char* facet) {
  uint16_t attributes;
  std::memcpy(&attributes, facet + kFacetBytes - 2, sizeof attributes);
  return attributes;
}

glm::dvec3 LoadPoint(const char* at) {
  float xyz[3];
  std::memcpy(xyz, at, sizeof xyz);
  return {xyz[0], xyz[1], xyz[2]};
}

/// A pipe or packed file has no size: its first facets decide, and its end if that is in the buffer.
bool StreamIsBinary(ModelReader& bytes) {
  constexpr double kFar = 1e15;
  if (bytes.has_size()) return false;
  const bool all = !bytes.Ensure(ModelReader::kBufferBytes);
  const uint64_t size = bytes.available();
  if (size < kHeaderBytes + kFacetBytes) return false;
  if (all && (size - kHeaderBytes) % kFacetBytes != 0) return false;
  if (IsCount(CountOf(bytes)) && (all ? PromisedBytes(bytes) != size : PromisedBytes(bytes) < size))
    return false;
  for (uint64_t i = 0; i < 100 && kHeaderBytes + (i + 1) * kFacetBytes <= size; ++i)
    for (int k = 0; k < 4; ++k) {
      const glm::dvec3 p = LoadPoint(bytes.data() + kHeaderBytes + i * kFacetBytes + 12 * k);
      if (!(std::fabs(p.x) < kFar && std::fabs(p.y) < kFar && std::fabs(p.z) < kFar)) return false;
    }
  return true;
}

/// Colours in the two attribute bytes of a facet, five bits a channel. VisCAM: facets with the highest bit
/// set, red highest. Magics, announced in the header: facets without it, red lowest; other facets have the
/// header's colour.
class FacetColors {
 public:
  explicit FacetColors(std::string_view header) {
    const size_t at = header.find("COLOR=");
    if (at == std::string_view::npos || at + 9 > header.size()) return;
    const auto channel = [&](size_t i) { return static_cast<uint8_t>(header[at + 6 + i]); };
    magics_ = true;
    of_all_ = FileColor(channel(0), channel(1), channel(2));
  }
  Rgba8 ColorOf(uint16_t attributes) const {
    const auto channel = [&](int shift) { return (attributes >> shift & 31) * 255 / 31.0; };
    if (((attributes & 0x8000) != 0) == magics_) return of_all_;
    return magics_ ? FileColor(channel(0), channel(5), channel(10))
                   : FileColor(channel(10), channel(5), channel(0));
  }

  /// Whether the attributes say something that is no colour.
  bool IsOther(uint16_t attributes) const {
    return !magics_ && attributes != 0 && (attributes & 0x8000) == 0;
  }

 private:
  bool magics_ = false;
  Rgba8 of_all_;
};

/// Facets that the sink gets at once. A fixed number: the store must not depend on how many are read at once.
constexpr size_t kFacetsOfGroup = 8192;

struct FacetOfFile {
  glm::dvec3 corners[3];
  Rgba8 color;
  bool has_other = false;  ///< attributes that are no colour
};

/// Binary STL, from its header on.
class BinaryStl {
 public:
  BinaryStl(ModelReader& bytes, ModelSink& sink) : bytes_(bytes), sink_(sink) {}

  Result<uint64_t> Import();

 private:
  Status Header();
  Result<bool> HasPayloads() const;
  Status Facets(const FacetColors& colors);
  Status GiveFacets(size_t count);
  Status FacetWithPayload();

  ModelReader& bytes_;
  ModelSink& sink_;
  uint64_t count_ = 0, read_ = 0;  ///< facets
  bool counted_ = true;            ///< false: facets continue to the file's end
  bool payloads_ = false;          ///< attributes are lengths of extra bytes after the facet
  bool has_others_ = false;        ///< attributes that are no colours
  Rgba8 color_;
  std::vector<FacetOfFile> facets_;  ///< read, and not given to the sink
  uint64_t given_ = 0;               ///< facets
};

Status BinaryStl::Header() {
  const std::string& path = bytes_.path();
  if (!bytes_.Ensure(kHeaderBytes))
    return Fail(
        fmt::format("{}: is not an ASCII STL, and as a binary STL it would need {} bytes, but it has {}",
                    path, kHeaderBytes, bytes_.available()));
  count_ = CountOf(bytes_);
  const uint64_t promised = PromisedBytes(bytes_);
  if (!IsCount(CountOf(bytes_))) {
    if (bytes_.has_size() && (bytes_.size() - kHeaderBytes) % kFacetBytes != 0)
      return Fail(fmt::format("{}: its count of facets is {}, and its size is not that of whole facets", path,
                              count_));
    counted_ = false;
    sink_.Warn(fmt::format("{}: its count of facets is {}; all facets up to the end are read", path, count_));
  } else if (bytes_.has_size() && promised > bytes_.size()) {
    return Fail(
        fmt::format("{}: is not an ASCII STL, and as a binary STL it would need {} bytes, but it has {}",
                    path, promised, bytes_.size()));
  } else if (bytes_.has_size() && promised < bytes_.size()) {
    QUARRY_ASSIGN(payloads_, HasPayloads());
    if (!payloads_)
      sink_.Warn(fmt::format("{}: {} bytes behind the last facet left out", path, bytes_.size() - promised));
  }
  return {};
}

/// Whether the facets end with the file if attributes are lengths. Reads the file once more.
Result<bool> BinaryStl::HasPayloads() const {
  QUARRY_ASSIGN(ModelReader ahead, ModelReader::Open(bytes_.path()));
  if (!ahead.Skip(kHeaderBytes)) return false;
  for (uint64_t i = 0; i < count_; ++i) {
    if (!ahead.Ensure(kFacetBytes)) return false;
    if (!ahead.Skip(kFacetBytes + AttributesOf(ahead.data()))) return false;
  }
  return ahead.remaining() == 0;
}

Result<uint64_t> BinaryStl::Import() {
  QUARRY_TRY(Header());
  const FacetColors colors(bytes_.view().substr(0, kHeaderBytes - 4));
  bytes_.Consume(kHeaderBytes);
  while (!counted_ || read_ < count_) {
    if (!counted_ && !bytes_.Ensure(1) && !bytes_.failed()) break;
    if (!bytes_.Ensure(kFacetBytes))
      return bytes_.Truncated(counted_ ? fmt::format("in facet {} of {}", read_, count_)
                                       : fmt::format("in facet {}", read_));
    if (read_ >= kMostFacets)
      return Fail(fmt::format(
          "{}: has more than {} facets: the numbers of their corners are 32 bits; split the model",
          bytes_.path(), kMostFacets));
    QUARRY_TRY(payloads_ ? FacetWithPayload() : Facets(colors));
  }
  QUARRY_TRY(GiveFacets(facets_.size()));
  if (counted_ && !bytes_.has_size() && bytes_.Ensure(1))
    sink_.Warn(fmt::format("{}: bytes behind the last facet left out", bytes_.path()));
  if (has_others_)
    sink_.Warn(fmt::format("{}: left out, since they are not read: attributes of facets that are not colours",
                           bytes_.path()));
  return read_;
}

Corner FacetCorner(uint64_t facet, uint32_t corner) {
  return Corner{static_cast<uint32_t>(3 * facet + corner), kNoIndex, kNoIndex};
}

/// Reads the facets in the buffer. Requires: there is one.
Status BinaryStl::Facets(const FacetColors& colors) {
  RowChunk chunk(bytes_, kFacetBytes, (counted_ ? std::min(count_, kMostFacets) : kMostFacets) - read_,
                 sink_.team());
  const size_t before = facets_.size();
  facets_.resize(before + chunk.rows());
  chunk.Decode([&](const char* row, size_t i) {
    FacetOfFile& facet = facets_[before + i];
    for (uint32_t k = 0; k < 3; ++k) facet.corners[k] = LoadPoint(row + 12 * (k + 1));
    const uint16_t attributes = AttributesOf(row);
    facet.color = colors.ColorOf(attributes);
    facet.has_other = colors.IsOther(attributes);
    return true;
  });
  chunk.Consume(chunk.rows());
  read_ += chunk.rows();
  while (facets_.size() >= kFacetsOfGroup) QUARRY_TRY(GiveFacets(kFacetsOfGroup));
  return {};
}

/// Gives the sink the first `count` facets that are waiting: their corners, then the triangles.
Status BinaryStl::GiveFacets(size_t count) {
  const std::span<const FacetOfFile> group = std::span(facets_).first(count);
  for (const FacetOfFile& facet : group)
    for (const glm::dvec3& corner : facet.corners) QUARRY_TRY(sink_.AddPosition(corner, Rgba8{}));
  for (const FacetOfFile& facet : group) {
    const Corner corners[] = {FacetCorner(given_, 0), FacetCorner(given_, 1), FacetCorner(given_, 2)};
    if (Packed(facet.color) != Packed(color_)) QUARRY_TRY(sink_.SetFaceColor(facet.color));
    color_ = facet.color;
    has_others_ |= facet.has_other;
    QUARRY_TRY(sink_.AddPolygon(corners, kNoIndex, kNoIndex));
    ++given_;
  }
  facets_.erase(facets_.begin(), facets_.begin() + static_cast<std::ptrdiff_t>(count));
  return {};
}

Status BinaryStl::FacetWithPayload() {
  const char* facet = bytes_.data();
  Corner corners[3];
  for (uint32_t k = 0; k < 3; ++k) {
    QUARRY_TRY(sink_.AddPosition(LoadPoint(facet + 12 * (k + 1)), Rgba8{}));
    corners[k] = FacetCorner(read_, k);
  }
  const uint16_t length = AttributesOf(facet);
  has_others_ |= length != 0;
  bytes_.Consume(kFacetBytes);
  if (!bytes_.Skip(length)) return bytes_.Truncated(fmt::format("behind facet {}", read_));
  ++read_;
  return sink_.AddPolygon(corners, kNoIndex, kNoIndex);
}

/// ASCII STL by words, since some writers put a facet on one line. Named solids are parts.
class AsciiStl {
 public:
  AsciiStl(ModelReader& bytes, ModelSink& sink) : bytes_(bytes), lines_(bytes), sink_(sink) {}

  Result<uint64_t> Import();

 private:
  Status Line(std::string_view line);
  Status Keyword(std::string_view word, TextCursor& rest);
  Status Vertex(TextCursor& rest);
  Status EndFacet();

  ModelReader& bytes_;
  LineReader lines_;
  ModelSink& sink_;
  std::vector<Corner> corners_;
  uint64_t positions_ = 0, triangles_ = 0;
  uint32_t part_ = kNoIndex;
  bool in_facet_ = false;
  std::string joined_;
};

Result<uint64_t> AsciiStl::Import() {
  std::string_view line;
  while (true) {
    QUARRY_ASSIGN(const bool more, lines_.Next(line));
    if (!more) break;
    QUARRY_TRY(Line(line));
  }
  if (in_facet_) return lines_.FailHere("the file ends within a facet");
  return triangles_;
}

Status AsciiStl::Line(std::string_view line) {
  TextCursor cursor(line);
  for (std::string_view word = cursor.Word(); !word.empty(); word = cursor.Word())
    QUARRY_TRY(Keyword(word, cursor));
  return {};
}

Status AsciiStl::Keyword(std::string_view word, TextCursor& rest) {
  const auto is = [&](std::string_view keyword) { return EqualsIgnoringCase(word, keyword); };
  const auto begins = [&](std::string_view start) {
    return EqualsIgnoringCase(word.substr(0, start.size()), start);
  };
  if (is("vertex")) return Vertex(rest);
  if (word == "\x1A") return {};  // the end of a text, to DOS
  if (is("end")) {                // "end loop"
    joined_ = "end" + std::string(rest.Word());
    return joined_.size() > 3 ? Keyword(joined_, rest) : Status{};
  }
  if (is("endfacet")) return EndFacet();
  if (is("facet")) {
    if (in_facet_) return lines_.FailHere("a facet begins within another");
    in_facet_ = true;
  } else if (is("normal")) {
    for (int i = 0; i < 3; ++i) rest.Word();
  } else if (begins("solid")) {
    rest.next = word.data() + 5;  // the name may follow without a blank
    std::string_view name = rest.Rest();
    // All of a file may stand in one line.
    const size_t facet = FindWord(name, "facet");
    const bool goes_on = facet != name.npos && FindWord(name.substr(facet), "vertex") != name.npos;
    if (goes_on) name = TextCursor(name.substr(0, facet)).Rest();
    part_ = name.empty() ? kNoIndex : sink_.AddPart(name, kNoIndex);
    rest.next = goes_on ? name.data() + name.size() : rest.end;
  } else if (begins("endsolid") || is("color") || word.starts_with('#')) {
    rest.next = rest.end;
  } else if (!is("outer") && !is("loop") && !is("outerloop") && !is("endloop")) {
    return lines_.FailHere(fmt::format("{} is not a word of an ASCII STL", Quoted(word)));
  }
  return {};
}

Status AsciiStl::Vertex(TextCursor& rest) {
  glm::dvec3 point;
  for (int i = 0; i < 3; ++i)
    if (!ParseReal(rest, point[i]))
      return lines_.FailHere("a vertex needs three numbers" +
                             (rest.AtEnd() ? std::string() : ", not " + Quoted(rest.Word())));
  if (!in_facet_) return lines_.FailHere("a vertex stands outside of any facet");
  if (corners_.size() == kMaxPolygonCorners)
    return lines_.FailHere(fmt::format("the facet has more than {} corners", kMaxPolygonCorners));
  QUARRY_TRY(sink_.AddPosition(point, Rgba8{}));
  Corner corner;
  corner.position = static_cast<uint32_t>(positions_++);
  corners_.push_back(corner);
  return {};
}

Status AsciiStl::EndFacet() {
  if (corners_.size() < 3) return lines_.FailHere(fmt::format("the facet has {} corners", corners_.size()));
  triangles_ += corners_.size() - 2;
  QUARRY_TRY(sink_.AddPolygon(corners_, kNoIndex, part_));
  corners_.clear();
  in_facet_ = false;
  return {};
}

}  // namespace

bool LooksLikeStl(ModelReader& bytes) {
  return SizeIsBinary(bytes) || LooksAscii(bytes) || StreamIsBinary(bytes);
}

Result<uint64_t> ImportStl(ModelReader& bytes, ModelSink& sink) {
  if (!SizeIsBinary(bytes) && LooksAscii(bytes)) return AsciiStl(bytes, sink).Import();
  return BinaryStl(bytes, sink).Import();
}

}  // namespace quarry
