// STL, ASCII and binary. Facet normals are left out: the triangle has its own.

#include <fmt/format.h>

#include <cstring>
#include <string>
#include <vector>

#include "preprocess/import/checkpoint.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/line_reader.h"
#include "preprocess/import/text_number.h"

namespace quarry {
namespace {

constexpr uint64_t kHeaderBytes = 84;     ///< 80 of text, 4 of count.
constexpr uint64_t kFacetsPerLook = 256;  ///< whether a checkpoint is due
constexpr uint64_t kFacetBytes = 50;      ///< Normal and three corners of 12 bytes, 2 bytes of attributes.

uint64_t PromisedBytes(ModelReader& bytes) {
  uint32_t count;
  std::memcpy(&count, bytes.data() + kHeaderBytes - 4, sizeof count);
  return kHeaderBytes + kFacetBytes * count;
}

bool BeginsWithSolid(ModelReader& bytes) {
  bytes.Ensure(1024);
  std::string_view text = bytes.view().substr(0, 1024);
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  while (!text.empty() && IsSpace(text.front())) text.remove_prefix(1);
  return text.size() >= 5 && EqualsIgnoringCase(text.substr(0, 5), "solid");
}

bool SizeIsBinary(ModelReader& bytes) {
  return bytes.has_size() && bytes.Ensure(kHeaderBytes) && PromisedBytes(bytes) == bytes.size();
}

/// Programs write "solid" into binary headers too; a zero byte near the start gives them away.
bool LooksAscii(ModelReader& bytes) {
  return BeginsWithSolid(bytes) && bytes.view().substr(0, 1024).find('\0') == std::string_view::npos;
}

glm::dvec3 LoadPoint(const char* at) {
  float xyz[3];
  std::memcpy(xyz, at, sizeof xyz);
  return {xyz[0], xyz[1], xyz[2]};
}

Status AddFacet(ModelSink& sink, const char* facet, uint64_t index) {
  Corner corners[3];
  for (uint32_t i = 0; i < 3; ++i) {
    QUARRY_TRY(sink.AddPosition(LoadPoint(facet + 12 * (i + 1)), Rgba8{}));
    corners[i].position = static_cast<uint32_t>(3 * index + i);
  }
  return sink.AddPolygon(corners, kNoIndex, kNoIndex);
}

/// How many facets of a binary file have been read.
struct FacetsRead {
  ModelReader& bytes;
  uint64_t count = 0;

  void Save(ByteWriter& out) const {
    out.Put(bytes.offset());
    out.Put(count);
  }
  Status Restore(ByteReader& in) {
    QUARRY_TRY(bytes.SkipTo(in.Get<uint64_t>()));
    count = in.Get<uint64_t>();
    return {};
  }
};

Result<uint64_t> ImportBinary(ModelReader& bytes, ModelSink& sink) {
  const uint64_t promised = bytes.Ensure(kHeaderBytes) ? PromisedBytes(bytes) : kHeaderBytes;
  if (bytes.has_size() && promised > bytes.size())
    return Fail(fmt::format("{}: is no ASCII STL, and as a binary STL it would need {} bytes, but it has {}",
                            bytes.path(), promised, bytes.size()));
  if (bytes.has_size() && promised < bytes.size())
    sink.Warn(
        fmt::format("{}: {} bytes behind the last facet left out", bytes.path(), bytes.size() - promised));
  bytes.Consume(kHeaderBytes);
  const uint64_t count = (promised - kHeaderBytes) / kFacetBytes;
  FacetsRead read{bytes};
  QUARRY_TRY(GoOnFromCheckpoint(sink, bytes.path(), read));
  for (uint64_t& i = read.count; i < count; ++i) {
    if (i % kFacetsPerLook == 0) QUARRY_TRY(CheckpointIfDue(sink, read));
    if (!bytes.Ensure(kFacetBytes)) return bytes.Truncated(fmt::format("in facet {} of {}", i, count));
    QUARRY_TRY(AddFacet(sink, bytes.data(), i));
    bytes.Consume(kFacetBytes);
  }
  if (!bytes.has_size() && bytes.Ensure(1))
    sink.Warn(fmt::format("{}: bytes behind the last facet left out", bytes.path()));
  return count;
}

/// ASCII STL by words, not lines: some writers put a facet on one line. Solids with names are parts.
class AsciiStl {
 public:
  AsciiStl(ModelReader& bytes, ModelSink& sink) : bytes_(bytes), lines_(bytes), sink_(sink) {}

  Result<uint64_t> Import();
  /// Between facets.
  void Save(ByteWriter& out) const {
    for (const uint64_t n : {bytes_.offset(), lines_.line_number(), positions_, triangles_}) out.Put(n);
    out.Put(part_);
  }
  Status Restore(ByteReader& in) {
    QUARRY_TRY(bytes_.SkipTo(in.Get<uint64_t>()));
    lines_.GoOnAfterLine(in.Get<uint64_t>());
    positions_ = in.Get<uint64_t>();
    triangles_ = in.Get<uint64_t>();
    part_ = in.Get<uint32_t>();
    return {};
  }

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
};

Result<uint64_t> AsciiStl::Import() {
  QUARRY_TRY(GoOnFromCheckpoint(sink_, bytes_.path(), *this));
  std::string_view line;
  while (true) {
    if (!in_facet_) QUARRY_TRY(CheckpointIfDue(sink_, *this));
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
  if (EqualsIgnoringCase(word, "vertex")) return Vertex(rest);
  if (EqualsIgnoringCase(word, "endfacet")) return EndFacet();
  if (EqualsIgnoringCase(word, "facet")) {
    if (in_facet_) return lines_.FailHere("a facet begins within another");
    in_facet_ = true;
  } else if (EqualsIgnoringCase(word, "normal")) {
    for (int i = 0; i < 3; ++i) rest.Word();
  } else if (EqualsIgnoringCase(word, "solid")) {
    const std::string_view name = rest.Rest();
    part_ = name.empty() ? kNoIndex : sink_.AddPart(name);
    rest.next = rest.end;
  } else if (EqualsIgnoringCase(word, "endsolid") || word.starts_with('#')) {
    rest.next = rest.end;
  } else if (!EqualsIgnoringCase(word, "outer") && !EqualsIgnoringCase(word, "loop") &&
             !EqualsIgnoringCase(word, "endloop")) {
    return lines_.FailHere(fmt::format("{} is no word of an ASCII STL", Quoted(word)));
  }
  return {};
}

Status AsciiStl::Vertex(TextCursor& rest) {
  glm::dvec3 point;
  for (int i = 0; i < 3; ++i)
    if (!ParseReal(rest, point[i])) return lines_.FailHere("a vertex needs three numbers");
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

bool LooksLikeStl(ModelReader& bytes) { return SizeIsBinary(bytes) || LooksAscii(bytes); }

Result<uint64_t> ImportStl(ModelReader& bytes, ModelSink& sink) {
  if (!SizeIsBinary(bytes) && LooksAscii(bytes)) return AsciiStl(bytes, sink).Import();
  return ImportBinary(bytes, sink);
}

}  // namespace quarry
