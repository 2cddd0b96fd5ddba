#include "preprocess/import/ply/ply_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "preprocess/import/text/line_reader.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

constexpr size_t kMaxElements = 256;
constexpr size_t kMaxProperties = 4096;

std::optional<PlyType> TypeFromName(std::string_view name) {
  constexpr std::pair<std::string_view, PlyType> kNames[] = {
      {"char", PlyType::kInt8},      {"int8", PlyType::kInt8},       {"uchar", PlyType::kUint8},
      {"uint8", PlyType::kUint8},    {"short", PlyType::kInt16},     {"int16", PlyType::kInt16},
      {"ushort", PlyType::kUint16},  {"uint16", PlyType::kUint16},   {"int", PlyType::kInt32},
      {"int32", PlyType::kInt32},    {"uint", PlyType::kUint32},     {"uint32", PlyType::kUint32},
      {"float", PlyType::kFloat32},  {"float32", PlyType::kFloat32}, {"double", PlyType::kFloat64},
      {"float64", PlyType::kFloat64}};
  for (const auto& [known, type] : kNames)
    if (known == name) return type;
  return std::nullopt;
}

/// Parses the lines after "ply".
class HeaderParser {
 public:
  explicit HeaderParser(ModelReader& bytes) : lines_(bytes) {}

  Result<PlyHeader> Parse();

 private:
  /// True: the line is end_header.
  Result<bool> Line(std::string_view line);
  Status Format(TextCursor& words);
  Status Element(TextCursor& words);
  Status Property(TextCursor& words);
  Result<PlyType> Type(std::string_view name) const;

  LineReader lines_;
  PlyHeader header_;
  bool has_format_ = false;
  size_t property_count_ = 0;
};

Result<PlyHeader> HeaderParser::Parse() {
  std::string_view line;
  QUARRY_ASSIGN(const bool any, lines_.Next(line));
  if (!any || TextCursor(line).Rest() != "ply") return lines_.FailHere("does not begin with \"ply\"");
  for (bool done = false; !done;) {
    QUARRY_ASSIGN(const bool more, lines_.Next(line));
    if (!more) return lines_.FailHere("the PLY header has no end_header");
    QUARRY_ASSIGN(done, Line(line));
  }
  if (!has_format_) return lines_.FailHere("the PLY header names no format");
  header_.lines = lines_.line_number();
  return std::move(header_);
}

Result<bool> HeaderParser::Line(std::string_view line) {
  TextCursor words(line);
  const std::string_view keyword = words.Word();
  if (keyword == "end_header") return true;
  if (keyword == "format") QUARRY_TRY(Format(words));
  if (keyword == "element") QUARRY_TRY(Element(words));
  if (keyword == "property") QUARRY_TRY(Property(words));
  if (keyword == "comment" && words.Word() == "TextureFile" &&
      header_.texture_files.size() < kMostTextureFiles)
    header_.texture_files.emplace_back(words.Rest());
  return false;
}

Status HeaderParser::Format(TextCursor& words) {
  const std::string_view name = words.Word();
  has_format_ = true;
  if (name == "ascii")
    header_.encoding = PlyEncoding::kAscii;
  else if (name == "binary_little_endian")
    header_.encoding = PlyEncoding::kBinaryLittleEndian;
  else if (name == "binary_big_endian")
    header_.encoding = PlyEncoding::kBinaryBigEndian;
  else
    return lines_.FailHere(fmt::format("the PLY format {} is not known", Quoted(name)));
  return {};
}

Status HeaderParser::Element(TextCursor& words) {
  PlyElement element;
  element.name = std::string(words.Word());
  words.SkipBlanks();
  int64_t count = -1;
  if (!ParseInteger(words, count) || count < 0 || !words.AtEnd())
    return lines_.FailHere(fmt::format("the element {} has no count", Quoted(element.name)));
  element.count = static_cast<uint64_t>(count);
  if (header_.Find(element.name) != nullptr)
    return lines_.FailHere(fmt::format("the element {} is named twice", Quoted(element.name)));
  if (header_.elements.size() == kMaxElements)
    return lines_.FailHere(fmt::format("more than {} elements", kMaxElements));
  header_.elements.push_back(std::move(element));
  return {};
}

Status HeaderParser::Property(TextCursor& words) {
  if (header_.elements.empty()) return lines_.FailHere("a property before any element");
  if (++property_count_ > kMaxProperties)
    return lines_.FailHere(fmt::format("more than {} properties", kMaxProperties));
  PlyProperty property;
  std::string_view type = words.Word();
  if (type == "list") {
    QUARRY_ASSIGN(property.count_type, Type(words.Word()));
    if (IsReal(*property.count_type)) return lines_.FailHere("the count of a list must have an integer type");
    type = words.Word();
  }
  QUARRY_ASSIGN(property.type, Type(type));
  property.name = std::string(words.Word());
  if (property.name.empty()) return lines_.FailHere("a property without a name");
  header_.elements.back().properties.push_back(std::move(property));
  return {};
}

Result<PlyType> HeaderParser::Type(std::string_view name) const {
  if (const auto type = TypeFromName(name)) return *type;
  return lines_.FailHere(fmt::format("the type {} is not known", Quoted(name)));
}

}  // namespace

const PlyElement* PlyHeader::Find(std::string_view name) const {
  const auto found = std::ranges::find(elements, name, &PlyElement::name);
  return found == elements.end() ? nullptr : &*found;
}

Result<PlyHeader> ReadPlyHeader(ModelReader& bytes) { return HeaderParser(bytes).Parse(); }

}  // namespace quarry
